import cv2
import numpy as np
import pytest

from deux.contracts import ExplorerMap
from deux.figures.drawing import save_figure
from deux.figures.trajectory import draw_trajectory
from deux.geometry.grid import GridFrame
from deux.geometry.poses import camera_pose


def explored(with_field: bool) -> ExplorerMap:
    frame = GridFrame(origin_x=-2.0, origin_z=1.0, rows=40, columns=60, resolution=0.1)
    occupancy = np.zeros(frame.shape, np.int8)
    occupancy[10:30, 10:50] = 2
    return ExplorerMap(frame, occupancy, np.where(occupancy == 2, 0.3, np.nan) if with_field else None)


def test_the_trajectory_lies_where_the_robot_went():
    poses = np.stack([camera_pose(x, 1.25, 3.0, 0.0) for x in np.linspace(-0.5, 2.5, 7)])
    figure = draw_trajectory(explored(with_field=False), poses)
    panel = figure.axes[0]
    path = next(c for c in panel.collections if c.get_array() is not None)
    points = np.concatenate([segment.vertices for segment in path.get_paths()])
    assert points[:, 0].min() == pytest.approx(-0.5)
    assert points[:, 0].max() == pytest.approx(2.5)
    assert set(points[:, 1]) == {3.0}
    assert panel.images[0].get_extent() == [-2.0, 4.0, 5.0, 1.0]
    assert panel.get_ylim()[0] > panel.get_ylim()[1]  # z grows downward, as in the map's rows


def test_the_uncertainty_field_is_a_second_panel():
    poses = np.stack([camera_pose(x, 1.25, 3.0, 0.0) for x in (0.0, 1.0)])
    titles = [axes.get_title() for axes in draw_trajectory(explored(with_field=True), poses).axes]
    assert "where the depth model is unsure" in titles
    assert "where the depth model is unsure" not in [
        axes.get_title() for axes in draw_trajectory(explored(with_field=False), poses).axes
    ]


def test_an_episode_of_one_frame_can_be_drawn(tmp_path):
    path = save_figure(draw_trajectory(explored(False), camera_pose(0.0, 1.25, 3.0, 0.0)[None]), tmp_path / "one.png")
    assert cv2.imread(str(path)).std() > 10
