"""The built-in simulator against Habitat-Sim: its images and navmesh of small_house, and what its actions mean."""

import math
from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np
import pytest
from scipy import ndimage
from scipy.spatial.transform import Rotation

from deux.contracts import Action, Robot, Scene, SceneReference
from deux.errors import DeuxError
from deux.geometry.camera import Camera
from deux.geometry.grid import FreeSpace, GridFrame
from deux.simulator.body import Body
from deux.simulator.mesh_simulator import MeshSimulator
from deux.simulator.renderers import make_renderer

STEP = 0.25


class Navmesh:
    """Habitat-Sim's navmesh in the plane, and a step on it as Detour's `moveAlongSurface` takes it.

    Detour visits the polygons around the start that are joined by edges within half a step of the step's middle; the
    step ends at its target, if one of them contains it, or at the nearest point of their walls.
    """

    def __init__(self, vertices: np.ndarray, triangles: np.ndarray) -> None:
        corners = vertices[triangles]
        _, number = np.unique(np.round(corners.reshape(-1, 3), 3), axis=0, return_inverse=True)
        edges: dict[frozenset[int], list[tuple[int, int]]] = {}
        for triangle, ids in enumerate(number.reshape(-1, 3).tolist()):
            for edge in range(3):
                edges.setdefault(frozenset((ids[edge], ids[(edge + 1) % 3])), []).append((triangle, edge))
        self.corners = corners[..., [0, 2]].astype(np.float64)
        self.beyond = np.full((len(triangles), 3), -1)
        for sides in edges.values():
            if len(sides) == 2:
                (one, one_edge), (other, other_edge) = sides
                self.beyond[one, one_edge], self.beyond[other, other_edge] = other, one
        self.island = self._reachable(int(np.argmax(self._areas())))

    def _areas(self) -> np.ndarray:
        first, second = self.corners[:, 1] - self.corners[:, 0], self.corners[:, 2] - self.corners[:, 0]
        return 0.5 * np.abs(first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0])

    def _reachable(self, triangle: int) -> list[int]:
        found, waiting = {triangle}, [triangle]
        while waiting:
            for other in self.beyond[waiting.pop()].tolist():
                if other >= 0 and other not in found:
                    found.add(other)
                    waiting.append(other)
        return sorted(found)

    @property
    def walls(self) -> np.ndarray:
        """The edges of the largest island that have nothing beyond them, W x 2 x 2."""
        ends = np.stack([self.corners, np.roll(self.corners, -1, axis=1)], axis=2)
        return ends[self.island][self.beyond[self.island] < 0]

    def containing(self, points: np.ndarray) -> np.ndarray:
        """The triangle of the largest island in which each of N x 2 points lies, -1 for none."""
        found = np.full(len(points), -1)
        for triangle in self.island:
            corners = self.corners[triangle]
            near = np.flatnonzero(((points >= corners.min(axis=0)) & (points <= corners.max(axis=0))).all(axis=-1))
            found[near[self._contains(triangle, points[near])]] = triangle
        return found

    def _contains(self, triangle: int, points: np.ndarray) -> np.ndarray:
        corners = self.corners[triangle]
        edge, to = np.roll(corners, -1, axis=0) - corners, points[..., None, :] - corners
        side = edge[:, 0] * to[..., 1] - edge[:, 1] * to[..., 0]
        return (side >= -1e-12).all(axis=-1) | (side <= 1e-12).all(axis=-1)

    def step(self, triangle: int, start: np.ndarray, target: np.ndarray) -> np.ndarray:
        """Where a step from `start`, in `triangle`, to `target` ends."""
        middle, radius = (start + target) / 2.0, float(np.linalg.norm(target - start)) / 2.0 + 0.001
        nearest, best = start, math.inf
        seen, waiting = {triangle}, [triangle]
        while waiting:
            here = waiting.pop(0)
            if self._contains(here, target):
                return target
            for edge in range(3):
                ends = self.corners[here, edge], self.corners[here, (edge + 1) % 3]
                other = int(self.beyond[here, edge])
                if other < 0:
                    point = on_segment(target, *ends)
                    if np.linalg.norm(point - target) < best:
                        nearest, best = point, float(np.linalg.norm(point - target))
                elif other not in seen and np.linalg.norm(on_segment(middle, *ends) - middle) <= radius:
                    seen.add(other)
                    waiting.append(other)
        return nearest


def on_segment(point: np.ndarray, start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """The point of a segment that is nearest to `point`."""
    along = end - start
    return start + np.clip((point - start) @ along / (along @ along), 0.0, 1.0) * along


@pytest.fixture(scope="module")
def navmesh(shared_data: Callable[[str], Path]) -> Navmesh:
    with np.load(shared_data("habitat") / "topdown_5cm.npz") as data:
        return Navmesh(data["navmesh_vertices"].astype(np.float64), data["navmesh_triangles"])


@pytest.fixture(scope="module")
def navmesh_floor(navmesh: Navmesh, small_house: Scene) -> FreeSpace:
    """The cells of 5 cm whose centres are on the navmesh: its walls lie on their borders, but for simplification."""
    low, high = small_house.mesh.bounds[:, [0, 2]].astype(np.float64)
    columns, rows = np.floor((high - low) / 0.05 + 1e-3).astype(int)
    frame = GridFrame(*low.tolist(), int(rows), int(columns))
    centres = np.stack([frame.centre(row, column) for row, column in np.ndindex(frame.shape)])
    free = (navmesh.containing(centres) >= 0).reshape(frame.shape)
    return FreeSpace(frame, free, ndimage.distance_transform_edt(free).astype(np.float32) * 0.05, 0.0)


def test_steps_end_where_they_do_on_habitats_navmesh(navmesh: Navmesh, navmesh_floor: FreeSpace) -> None:
    """From places near walls, where most steps meet one. docs/habitat-agreement.md has the numbers and the reasons."""
    rng = np.random.default_rng(0)
    body = Body(navmesh_floor)
    walls = navmesh.walls
    ends = walls[rng.choice(len(walls), 2500, p=edge_lengths(walls) / edge_lengths(walls).sum())]
    places = ends[:, 0] + rng.uniform(0.0, 1.0, (2500, 1)) * (ends[:, 1] - ends[:, 0]) + rng.normal(0.0, 0.1, (2500, 2))
    differences, met = [], []
    for place, triangle in zip(places, navmesh.containing(places), strict=True):
        if triangle < 0 or not body.stands_at(*place):
            continue
        yaw = rng.uniform(-np.pi, np.pi)
        target = place - STEP * np.array([math.sin(yaw), math.cos(yaw)])
        expected = navmesh.step(triangle, place, target)
        x, z, collided = body.move(*place, yaw, STEP)
        differences.append(math.dist((x, z), expected))
        met.append((collided, collides(place, expected)))
    difference, (ours, theirs) = np.array(differences), np.array(met).T
    assert (ours & theirs).sum() > 300
    assert (ours != theirs).mean() < 0.05
    assert np.percentile(difference[~ours & ~theirs], 95) < 1e-6
    assert np.median(difference[ours & theirs]) < 0.02
    assert np.percentile(difference[ours & theirs], 90) < 0.06


def edge_lengths(edges: np.ndarray) -> np.ndarray:
    return np.linalg.norm(edges[:, 1] - edges[:, 0], axis=-1)


def collides(start: np.ndarray, end: np.ndarray) -> bool:
    """Habitat-Sim's rule."""
    return bool(((end - start) ** 2).sum() + 1e-5 < STEP**2)


@pytest.mark.parametrize(
    ("action", "moved", "turned"),
    [(Action.FORWARD, (0.0, -0.25), 0.0), (Action.LEFT, (0.0, 0.0), 10.0), (Action.RIGHT, (0.0, 0.0), -10.0)],
)
def test_actions_are_habitats(simulator: MeshSimulator, action: Action, moved: tuple, turned: float) -> None:
    simulator.reset(2.0, 1.5, 0.0)
    before = simulator.pose
    assert simulator.step(action) is False
    np.testing.assert_allclose((simulator.pose - before)[[0, 2], 3], moved, atol=1e-7)
    assert simulator.pose[1, 3] == 1.25
    expected = Rotation.from_euler("y", turned, degrees=True).as_matrix() @ before[:3, :3]
    np.testing.assert_allclose(simulator.pose[:3, :3], expected, atol=1e-12)


def test_after_a_left_turn_forward_is_where_it_is_in_habitat(simulator: MeshSimulator) -> None:
    simulator.reset(2.0, 1.5, 0.0)
    simulator.step(Action.LEFT)
    before = simulator.pose
    simulator.step(Action.FORWARD)
    np.testing.assert_allclose((simulator.pose - before)[:3, 3], (-0.0434, 0.0, -0.2462), atol=5e-5)


def test_36_turns_lead_back_to_the_same_pose(simulator: MeshSimulator) -> None:
    simulator.reset(2.0, 1.5, 0.7)
    before = simulator.pose
    for _ in range(36):
        simulator.step(Action.LEFT)
    np.testing.assert_allclose(simulator.pose, before, atol=1e-12)  # Habitat-Sim drifts by 3e-7


def test_turns_never_collide_and_steps_into_walls_do(simulator: MeshSimulator) -> None:
    simulator.reset(2.0, 0.2, 0.0)
    assert simulator.step(Action.FORWARD) is True
    at_the_wall = simulator.pose
    assert simulator.step(Action.FORWARD) is True
    np.testing.assert_allclose(simulator.pose, at_the_wall, atol=1e-6)
    assert simulator.step(Action.LEFT) is False
    for _ in range(5):
        assert simulator.step(Action.LEFT) is False
    before = simulator.pose
    assert simulator.step(Action.FORWARD) is True, "a slide is a collision too"
    np.testing.assert_allclose((simulator.pose - before)[[0, 2], 3], (-0.2165, 0.0), atol=5e-5)


@pytest.fixture
def simulator(box: Scene, refer: Callable[[Scene], SceneReference]) -> MeshSimulator:
    """A robot in a closed room of 4 x 3 m."""
    return MeshSimulator(refer(box), Camera(8, 8), Robot())


def sensor_pose(data: np.lib.npyio.NpzFile) -> np.ndarray:
    """Habitat-Sim's sensor pose as a camera-to-world matrix in OpenCV's camera axes."""
    pose = np.eye(4)
    rotation = Rotation.from_quat(data["sensor_rotation_wxyz"], scalar_first=True).as_matrix()
    pose[:3, :3] = rotation @ np.diag([1.0, -1.0, -1.0])
    pose[:3, 3] = data["sensor_position"]
    return pose


@pytest.mark.parametrize(
    ("name", "views", "color", "alike"), [("embree", range(12), 0.5, 0.99), ("pyrender", (2, 4, 10), 0.04, 0.999)]
)
def test_images_are_habitats(
    small_house: Scene, shared_data: Callable[[str], Path], name: str, views: Iterable[int], color: float, alike: float
) -> None:
    """Depth, and colours: their mean difference in grey levels and the share that differs by two levels at most."""
    camera = Camera(400, 400, 90.0, min_depth=0.0, max_depth=1000.0)
    try:
        renderer = make_renderer(name, small_house.mesh, camera)
        renderer.render(np.eye(4)[None])
    except DeuxError as error:
        pytest.skip(str(error))
    for view in views:
        with np.load(shared_data("habitat") / f"pose_{view:02d}.npz") as data:
            (image,) = renderer.render(sensor_pose(data)[None])
            seen, rgb, depth = data["depth"] > 0.0, data["rgb"].astype(int), data["depth"]
        np.testing.assert_array_equal(image.depth > 0.0, seen)
        error = np.abs(image.depth - depth)[seen]
        assert np.percentile(error, 95) < 3e-4
        assert (error > 0.01).mean() < 5e-4
        difference = np.abs(image.rgb - rgb)
        assert difference.mean() < color
        assert (difference <= 2).mean() > alike
        assert (difference > 10).mean() < 5e-4
