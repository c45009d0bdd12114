import numpy as np
import pytest

from deux.figures.drawing import save_figure
from deux.figures.trajectory_grid import Trajectory, draw_trajectory_grid, explored_plan
from deux.geometry.grid import FreeSpace, GridFrame

PLAN_FRAME = GridFrame(0.0, 0.0, rows=40, columns=60, resolution=0.05)  # 3 m x 2 m
MAP_FRAME = GridFrame(-1.0, -1.0, rows=50, columns=20, resolution=0.1)  # x to 1 m, z to 4 m


@pytest.fixture
def plan() -> FreeSpace:
    clearance = np.full(PLAN_FRAME.shape, 0.5, np.float32)
    clearance[:, 30] = 0.0  # a wall at x = 1.5
    return FreeSpace(PLAN_FRAME, clearance > 0.1, clearance, 0.0)


def trajectory(title: str, steps: int) -> Trajectory:
    cells = np.zeros(MAP_FRAME.shape, np.int8)
    cells[10:20, 10:15] = 2  # x 0 to 0.5, z 0 to 1
    cells[10:20, 15] = 1
    path = np.stack([np.linspace(0.1, 0.4, steps), np.full(steps, 0.5)], axis=1)
    return Trajectory(title, path, MAP_FRAME, cells)


def test_what_the_map_knows_is_laid_over_the_true_floor(plan):
    picture = explored_plan(plan, trajectory("a", 3))
    assert (picture[:, 30] == 1).all()
    explored = np.argwhere(picture == 2)
    np.testing.assert_array_equal(explored.min(axis=0), [0, 0])
    np.testing.assert_array_equal(explored.max(axis=0), [19, 11])  # z to 1 m; x to 0.6 m with the occupied cell
    assert len(explored) == 20 * 12
    assert (np.delete(picture, 30, axis=1) != 1).all()


def test_each_explorer_has_a_panel_and_all_share_one_clock(plan, tmp_path):
    figure = draw_trajectory_grid(
        plan, [trajectory(name, steps) for name, steps in zip("abcd", (3, 5, 9, 1), strict=True)]
    )
    panels = [axes for axes in figure.axes if axes.images]
    assert [panel.get_title() for panel in panels] == list("abcd")
    paths = [next(c for c in panel.collections if c.get_array() is not None) for panel in panels]
    assert {path.get_clim() for path in paths} == {(0, 8)}
    assert [len(path.get_array()) for path in paths] == [2, 4, 8, 0]
    assert {tuple(panel.images[0].get_extent()) for panel in panels} == {(0.0, 3.0, 2.0, 0.0)}
    assert save_figure(figure, tmp_path / "grid.png").stat().st_size > 10_000
