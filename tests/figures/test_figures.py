import cv2
import numpy as np
import pytest

from deux.contracts import ExplorerMap
from deux.figures.depth_panels import DepthSample, draw_depth_panels
from deux.figures.drawing import save_figure
from deux.figures.training_curve import draw_training_curve
from deux.figures.trajectory import draw_trajectory
from deux.geometry.grid import GridFrame
from deux.geometry.poses import camera_pose


def sample(height: int = 24, width: int = 32, depth: float = 2.0) -> DepthSample:
    truth = np.full((height, width), depth, np.float32)
    truth[:4] = 0.0
    sparse = np.zeros_like(truth)
    sparse[10, 10] = depth
    residual = np.full_like(truth, 0.1)
    residual[0, 0] = np.nan
    return DepthSample(np.zeros((height, width, 3), np.uint8), sparse, truth + 0.5, truth, residual)


def test_depth_panels_share_one_scale_over_all_rows():
    figure = draw_depth_panels([sample(depth=2.0), sample(depth=4.0)])
    panels = [axes for axes in figure.axes if axes.images]
    predictions = [axes.images[0] for axes in panels if axes.images[0].get_cmap().name == "turbo"]
    assert len(predictions) == 4  # two predictions, two ground truths
    assert [image.get_clim() for image in predictions] == [(0.0, pytest.approx(4.0))] * 4


def test_the_error_panel_shows_the_absolute_error_and_nothing_without_ground_truth():
    figure = draw_depth_panels([sample()])
    error = next(a.images[0].get_array() for a in figure.axes if a.images and a.images[0].get_cmap().name == "magma")
    assert np.ma.getmaskarray(error)[:4].all()
    np.testing.assert_allclose(error[4:], 0.5)


def test_a_sample_with_nothing_in_it_can_be_drawn(tmp_path):
    empty = np.zeros((8, 8), np.float32)
    nothing = DepthSample(np.zeros((8, 8, 3), np.uint8), empty, empty + 1.0, empty, np.full_like(empty, np.nan))
    save_figure(draw_depth_panels([nothing]), tmp_path / "panels.png")


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
    save_figure(draw_trajectory(explored(False), camera_pose(0.0, 1.25, 3.0, 0.0)[None]), tmp_path / "one.png")


def test_training_curve_joins_the_logs_of_a_run_that_was_killed(tmp_path):
    for version, text in enumerate(
        (
            "epoch,step,train/loss,validation/mae\n0,9,2.5,\n0,19,1.5,\n0,19,,300\n1,29,9.0,\n",
            "epoch,step,train/loss,validation/mae\n1,29,1.0,\n1,39,,200\n",
        )
    ):
        (tmp_path / f"version_{version}").mkdir()
        (tmp_path / f"version_{version}" / "metrics.csv").write_text(text)
    losses, errors = draw_training_curve(tmp_path).axes
    assert losses.lines[0].get_xydata().tolist() == [[9, 2.5], [19, 1.5], [29, 1.0]]
    assert errors.lines[0].get_xydata().tolist() == [[19, 300.0], [39, 200.0]]


def test_figures_are_written_whole(tmp_path):
    path = save_figure(draw_depth_panels([sample()]), tmp_path / "new" / "panels.png")
    image = cv2.imread(str(path))
    assert image is not None
    assert image.shape[1] > 1000
    assert image.std() > 10
    assert [file.name for file in path.parent.iterdir()] == ["panels.png"]
