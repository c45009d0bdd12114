import numpy as np
import pytest

from deux_plugins.simulators.habitat.navmesh import clearance, sample_navmesh


class Pathfinder:
    """A navmesh of given islands: a list of vertices and a list of triangles' indices each."""

    def __init__(self, *islands: tuple[list[tuple[float, float, float]], list[int]]) -> None:
        self._islands = islands
        self.num_islands = len(islands)

    def build_navmesh_vertices(self, island_index: int = -1) -> list[np.ndarray]:
        return [np.array(vertex, np.float32) for vertex in self._islands[island_index][0]]

    def build_navmesh_vertex_indices(self, island_index: int = -1) -> list[int]:
        return self._islands[island_index][1]


def ramp(x0: float, x1: float, z0: float, z1: float, y0: float, y1: float) -> tuple[list, list]:
    """An island of two triangles that rises along x."""
    return [(x0, y0, z0), (x1, y1, z0), (x1, y1, z1), (x0, y0, z1)], [0, 1, 2, 0, 2, 3]


def test_samples_are_the_plane_at_the_centres_of_the_cells_within() -> None:
    samples = sample_navmesh(Pathfinder(ramp(0.0, 2.0, 0.0, 1.0, 0.5, 1.5)), 0.1)
    assert len(samples.rows) == 20 * 10, "a cell on the diagonal is missing or there twice"
    x = samples.frame.origin_x + (samples.columns + 0.5) * 0.1
    z = samples.frame.origin_z + (samples.rows + 0.5) * 0.1
    assert (x.min(), x.max()) == pytest.approx((0.05, 1.95))
    assert (z.min(), z.max()) == pytest.approx((0.05, 0.95))
    np.testing.assert_allclose(samples.heights, 0.5 + x / 2.0, atol=1e-6)


def test_the_area_of_the_samples_is_that_of_a_mesh_of_any_shape() -> None:
    rng = np.random.default_rng(0)
    angles = np.sort(rng.uniform(0.0, 2.0 * np.pi, 60))
    rim = [(3.0 * np.cos(a), 0.2, 2.0 * np.sin(a)) for a in angles]
    fan = [index for number in range(60) for index in (0, 1 + number, 1 + (number + 1) % 60)]
    samples = sample_navmesh(Pathfinder(([(0.0, 0.2, 0.0), *rim], fan)))
    corners = np.array(rim)[:, [0, 2]]
    following = np.roll(corners, -1, axis=0)
    area = abs((corners[:, 0] * following[:, 1] - corners[:, 1] * following[:, 0]).sum()) / 2.0
    assert len(samples.rows) * 0.05**2 == pytest.approx(area, rel=0.005)


def test_storeys_above_each_other_are_samples_of_their_own() -> None:
    samples = sample_navmesh(Pathfinder(ramp(0, 1, 0, 1, 0, 0), ramp(0, 1, 0, 1, 3, 3)), 0.1)
    assert len(samples.rows) == 200
    assert set(zip(samples.islands.tolist(), np.round(samples.heights, 3).tolist(), strict=True)) == {
        (0, 0.0),
        (1, 3.0),
    }
    assert np.nanmax(samples.grid()) == 0.0
    assert np.isfinite(samples.grid()).sum() == 100


def test_clearance_is_measured_from_the_obstacles() -> None:
    on_navmesh = np.zeros((40, 60), bool)
    on_navmesh[10:30, 10:50] = True
    metres = clearance(on_navmesh, 0.05, 0.2)
    # The navmesh ends half a cell from the last centre, and 0.2 m from what is in the way.
    assert metres[20, 10] == pytest.approx(0.025 + 0.2)
    assert metres[20, 9] == pytest.approx(0.2 - 0.025)
    assert metres[19, 30] == pytest.approx(9.5 * 0.05 + 0.2)
    assert metres[0, 0] == 0.0
    assert clearance(np.ones((3, 3), bool), 0.05, 0.2)[1, 1] == pytest.approx(0.275), "the grid's outside is no floor"
