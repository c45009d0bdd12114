import numpy as np
import pytest
from scipy import ndimage

from deux.contracts import Robot
from deux.contracts.scene import SceneArea
from deux.errors import DeuxError
from deux.geometry.grid import GridFrame
from deux_plugins.simulators.habitat.navmesh import NavmeshSamples
from deux_plugins.simulators.habitat.storeys import Storey, find_storeys

FRAME = GridFrame(0.0, 0.0, 100, 100, 0.1)  # 10 m x 10 m
LIFT = 0.15  # metres of the navmesh above the ground
ROBOT = Robot()


def sheet(
    x0: float, x1: float, z0: float, z1: float, y0: float, y1: float | None = None, island: int = 0
) -> NavmeshSamples:
    """A piece of navmesh over ground that rises along x from `y0` to `y1`."""
    rows, columns = (
        indices.ravel() for indices in np.mgrid[round(z0 * 10) : round(z1 * 10), round(x0 * 10) : round(x1 * 10)]
    )
    x = (columns + 0.5) * 0.1
    heights = y0 + (x - x0) / (x1 - x0) * ((y0 if y1 is None else y1) - y0) + LIFT
    return NavmeshSamples(FRAME, rows, columns, heights, np.full(len(rows), island))


def building(*sheets: NavmeshSamples) -> NavmeshSamples:
    names = ("rows", "columns", "heights", "islands")
    return NavmeshSamples(FRAME, *(np.concatenate([getattr(one, name) for one in sheets]) for name in names))


def storeys(
    samples: NavmeshSamples, area: SceneArea | None = None, roof: float = np.inf, headroom: float = 1.5
) -> tuple[Storey, ...]:
    """Found with a survey that sees all ground of the samples, and a ceiling over all that is lower than `roof`."""

    def ground(frame: GridFrame, level: float, clear: float) -> np.ndarray:
        assert (frame, clear) == (FRAME, headroom)
        near = samples.selected((samples.heights <= level + clear) & (samples.heights >= level - 3.0))
        highest = np.full(frame.shape, -np.inf)
        np.maximum.at(highest, (near.rows, near.columns), near.heights - LIFT)
        return np.where(np.isfinite(highest), highest, np.nan)

    def covered(frame: GridFrame, level: float, clear: float) -> np.ndarray:
        return np.full(frame.shape, level < roof)

    return find_storeys(samples, ROBOT, area or SceneArea(), ground, covered)


TWO = building(
    sheet(0.0, 6.0, 0.0, 5.0, 0.0),  # 30 m2
    sheet(6.0, 10.0, 0.0, 1.0, 0.0, 2.8),  # stairs
    sheet(0.0, 10.0, 1.0, 9.0, 2.8),  # 80 m2; beside the stairs' top
    sheet(8.0, 9.0, 8.0, 9.0, 0.0, island=1),  # a cupboard's floor
)


def test_the_largest_storey_is_taken_and_all_are_listed_from_the_largest() -> None:
    (main,) = storeys(TWO)
    assert main.floor.height == pytest.approx(2.8)
    assert main.space.floor_height == main.floor.height
    assert main.floor.area == pytest.approx(main.space.area)
    both = storeys(TWO, SceneArea(floor="all"))
    assert [storey.floor.height for storey in both] == pytest.approx([2.8, 0.0], abs=0.01)


def test_numbers_count_from_the_lowest() -> None:
    assert storeys(TWO, SceneArea(floor=0))[0].floor.height == pytest.approx(0.0, abs=0.01)
    assert storeys(TWO, SceneArea(floor=1))[0].floor.height == pytest.approx(2.8)
    with pytest.raises(DeuxError, match=r"no floor 2: counted from the lowest there is 0 at 0\.00 m of 32\.0 m2, 1 at"):
        storeys(TWO, SceneArea(floor=2))


def test_stairs_belong_to_either_storey_up_to_half_way_and_carry_the_robot() -> None:
    (lower,) = storeys(TWO, SceneArea(floor=0))
    assert lower.floor.area == pytest.approx(30.0 + 2.0)
    assert lower.navmesh_at(7.05, 0.5) == pytest.approx(1.05 * 0.7 + LIFT, abs=1e-3)
    assert lower.ground_at(7.05, 0.5) == pytest.approx(1.05 * 0.7, abs=1e-3)
    assert lower.navmesh_at(8.5, 0.5) is None
    assert ndimage.label(lower.space.free, np.ones((3, 3)))[1] == 1
    assert lower.navmesh_at(8.5, 8.5) is None, "another island is another place"


def test_ground_is_known_one_cell_beside_the_free_floor() -> None:
    (main,) = storeys(building(sheet(2.0, 4.0, 2.0, 4.0, 1.0)))
    assert main.ground_at(1.95, 3.0) == pytest.approx(1.0)
    assert main.navmesh_at(1.95, 3.0) is None
    assert main.ground_at(1.75, 3.0) is None
    assert main.ground_at(-5.0, 3.0) is None


def test_ground_that_is_hidden_from_above_is_the_navmesh_without_its_usual_lift() -> None:
    samples = building(sheet(0.0, 5.0, 0.0, 5.0, 0.0), sheet(5.0, 5.5, 0.0, 5.0, 0.0, 0.4))

    def ground(frame: GridFrame, level: float, headroom: float) -> np.ndarray:
        seen = samples.grid() - LIFT
        seen[:, 20:30] = np.nan
        seen[:, 30:35] = 1.2  # a beam under the headroom
        return seen

    (main,) = find_storeys(samples, ROBOT, SceneArea(), ground, lambda frame, *_: np.ones(frame.shape, bool))
    np.testing.assert_allclose(main.space.heights[:50, :50], 0.0, atol=1e-6)
    assert main.space.heights[10, 54] == pytest.approx(0.36, abs=1e-3)


def test_a_roof_is_no_floor_unless_nothing_lies_under_a_ceiling() -> None:
    samples = building(sheet(0.0, 9.0, 0.0, 9.0, 0.0), sheet(0.0, 10.0, 0.0, 10.0, 3.0, island=1))
    assert storeys(samples, roof=2.0)[0].floor.height == pytest.approx(0.0)
    assert len(storeys(samples, SceneArea(floor="all"), roof=2.0)) == 1
    assert storeys(samples, roof=-1.0)[0].floor.height == pytest.approx(3.0)


def test_furniture_is_no_storey() -> None:
    samples = building(
        sheet(0.0, 9.0, 0.0, 9.0, 0.0),
        sheet(9.2, 10.0, 0.0, 6.0, 0.9, island=1),
        sheet(0.0, 1.0, 9.2, 9.8, 4.0, island=2),
    )
    found = storeys(samples, SceneArea(floor="all"))
    assert [storey.floor.area for storey in found] == pytest.approx([81.0])


def test_a_region_and_a_start_choose_the_part() -> None:
    samples = building(sheet(0.0, 4.0, 0.0, 4.0, 0.0), sheet(5.0, 10.0, 5.0, 10.0, 0.0, island=1))
    assert storeys(samples)[0].navmesh_at(7.0, 7.0) is not None
    started = storeys(samples, SceneArea(start=(1.0, 1.0)))[0]
    assert started.floor.area == pytest.approx(16.0)
    within = storeys(samples, SceneArea(region=(0.0, 1.0, 3.0, 8.0)))[0]
    assert within.floor.area == pytest.approx(9.0)
    assert within.navmesh_at(3.5, 2.0) is None
    for area, said in ((SceneArea(start=(4.5, 4.5)), "start"), (SceneArea(region=(20.0, 0.0, 30.0, 9.0)), "region")):
        with pytest.raises(DeuxError, match=said):
            storeys(samples, area)


def test_a_navmesh_of_crumbs_has_no_floor() -> None:
    with pytest.raises(DeuxError, match="no floor to stand on"):
        storeys(building(sheet(0.0, 0.5, 0.0, 0.5, 0.0)))
