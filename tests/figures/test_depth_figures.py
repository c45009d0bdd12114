from dataclasses import replace

import cv2
import matplotlib
import numpy as np
import pytest
import torch
from PIL import Image

from deux.contracts import Batch, DepthModel, Prediction
from deux.figures.depth_figures import DepthSample, depth_samples, draw_depth, draw_depth_panels
from deux.figures.drawing import save_figure


def test_the_scale_tells_the_depth():
    """Colours of the picture, looked up in the scale's own ends and colour map, are the depth that was drawn."""
    depth = np.linspace(1.0, 5.0, 60 * 80).reshape(60, 80)
    figure = draw_depth(depth)
    axes, bar = figure.axes
    (picture,) = axes.images
    assert picture.get_clim() == pytest.approx((1.04, 4.96), abs=1e-3)
    assert bar.get_ylabel() == "depth [m]"
    inner = depth[30]
    expected = matplotlib.colormaps["turbo"]((inner - 1.04) / 3.92)
    np.testing.assert_allclose(picture.to_rgba(inner), expected, atol=0.01)


@pytest.mark.parametrize("shape", [(1, 1), (2, 500), (500, 2), (60, 80)])
@pytest.mark.parametrize("metres", [0.0, 2.0])
def test_any_map_can_be_drawn(tmp_path, shape, metres):
    """Also without any depth, of one depth only, and far longer than wide; warnings are errors here."""
    path = save_figure(draw_depth(np.full(shape, metres)), tmp_path / "depth.png")
    with Image.open(path) as picture:
        assert min(picture.size) > 200


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
    path = save_figure(draw_depth_panels([nothing]), tmp_path / "panels.png")
    assert cv2.imread(str(path)).std() > 10


def test_the_panels_are_written_as_one_picture(tmp_path):
    path = save_figure(draw_depth_panels([sample()]), tmp_path / "new" / "panels.png")
    image = cv2.imread(str(path))
    assert image is not None
    assert image.shape[1] > 1000
    assert image.std() > 10
    assert [file.name for file in path.parent.iterdir()] == ["panels.png"]


class Constant(DepthModel):
    """Predicts 2 m everywhere."""

    min_depth, max_depth = 0.1, 10.0

    def __init__(self) -> None:
        super().__init__()
        self.depth = torch.nn.Parameter(torch.tensor(2.0))

    def forward(self, image, sparse_depth, validity, intrinsics, **prepared):
        return Prediction(self.depth.expand_as(sparse_depth))


@pytest.fixture
def batch() -> Batch:
    """Two frames of a robot that stands still in front of noise."""
    rng = np.random.default_rng(0)
    image = torch.from_numpy(rng.random((2, 3, 16, 16))).float()
    depth = torch.from_numpy(rng.uniform(1.0, 4.0, (2, 1, 16, 16))).float()
    intrinsics = torch.tensor([[8.0, 0.0, 7.5], [0.0, 8.0, 7.5], [0.0, 0.0, 1.0]]).expand(2, 3, 3)
    still = torch.eye(4).expand(2, 2, 4, 4)
    sources = image[:, None].expand(-1, 2, -1, -1, -1)
    return Batch(image, sources, depth, torch.ones_like(depth), depth, intrinsics, still, ground_truth=depth)


def test_samples_hold_what_the_model_saw_and_a_robot_that_stands_still_leaves_no_residual(batch):
    samples = depth_samples(Constant(), batch)
    assert len(samples) == 2
    assert samples[0].rgb.dtype == np.uint8
    assert (samples[0].predicted_depth == 2.0).all()
    assert np.nanmax(samples[0].residual) < 1e-4


def test_frames_without_poses_have_no_residual_and_can_be_drawn(batch, tmp_path):
    samples = depth_samples(Constant(), replace(batch, source_from_target=None))
    assert np.isnan(samples[0].residual).all()
    assert (samples[0].predicted_depth == 2.0).all()
    save_figure(draw_depth_panels(samples), tmp_path / "panels.png")
