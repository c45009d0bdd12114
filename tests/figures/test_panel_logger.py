"""The pictures in TensorBoard: one grid, a row for each frame."""

from pathlib import Path

import matplotlib
import numpy as np
import torch
from lightning.pytorch.loggers import TensorBoardLogger
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator
from torch import Tensor

from deux.contracts import Batch, DepthModel, Prediction
from deux.figures.depth_figures import DepthSample
from deux.figures.panel_logger import PanelLogger, panel_grid
from deux.training.module import DepthCompletion

HEIGHT, WIDTH, GAP = 24, 32, 2


def sample(depth: float = 2.0, predicted: float = 2.5) -> DepthSample:
    truth = np.full((HEIGHT, WIDTH), depth, np.float32)
    truth[:4] = 0.0
    sparse = np.zeros_like(truth)
    sparse[10, 10] = depth
    image = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
    image[..., 1] = 102
    return DepthSample(image, sparse, np.full_like(truth, predicted), truth, np.full_like(truth, np.nan))


def panel(grid: Tensor, row: int, column: int) -> Tensor:
    top, left = GAP + row * (HEIGHT + GAP), GAP + column * (WIDTH + GAP)
    return grid[:, top : top + HEIGHT, left : left + WIDTH]


def turbo(fraction: float) -> Tensor:
    return torch.tensor(matplotlib.colormaps["turbo"](fraction)[:3])


def test_rows_are_frames_and_columns_what_is_shown() -> None:
    grid = panel_grid([sample(2.0), sample(4.0)])
    assert grid.shape == (3, 2 * (HEIGHT + GAP) + GAP, 6 * (WIDTH + GAP) + GAP)
    torch.testing.assert_close(panel(grid, 0, 0)[:, 5, 5], torch.tensor([0.0, 0.4, 0.0]))
    torch.testing.assert_close(panel(grid, 1, 0), panel(grid, 0, 0))


def test_depth_has_one_scale_over_all_rows() -> None:
    grid = panel_grid([sample(2.0), sample(4.0)])  # which ends at 4 m
    torch.testing.assert_close(panel(grid, 0, 3)[:, 10, 0], turbo(0.5), check_dtype=False)
    torch.testing.assert_close(panel(grid, 1, 3)[:, 10, 0], turbo(1.0), check_dtype=False)
    torch.testing.assert_close(panel(grid, 1, 2)[:, 10, 0], turbo(2.5 / 4.0), check_dtype=False)


def test_a_sparse_point_is_three_pixels_wide_on_grey() -> None:
    sparse = panel(panel_grid([sample()]), 0, 1)
    colored = (sparse - 0.85).abs().amax(dim=0) > 1e-6
    assert colored.nonzero().tolist() == [[row, column] for row in (9, 10, 11) for column in (9, 10, 11)]


def test_there_is_no_error_without_truth_and_no_residual_without_a_view() -> None:
    grid = panel_grid([sample()])
    grey = torch.full((), 0.85)
    torch.testing.assert_close(panel(grid, 0, 4)[:, :4], grey.expand(3, 4, WIDTH))
    assert float((panel(grid, 0, 4)[:, 4:] - grey).abs().amax(dim=0).min()) > 0.1
    torch.testing.assert_close(panel(grid, 0, 5), grey.expand(3, HEIGHT, WIDTH))


class Constant(DepthModel):
    min_depth, max_depth = 0.1, 10.0

    def __init__(self) -> None:
        super().__init__()
        self.depth = torch.nn.Parameter(torch.tensor(2.0))

    def forward(self, image: Tensor, sparse_depth: Tensor, *_: Tensor, **prepared: Tensor) -> Prediction:
        return Prediction(self.depth.expand_as(sparse_depth))


class Completion(DepthCompletion):
    """Only the model of a training."""

    def __init__(self, model: DepthModel) -> None:
        torch.nn.Module.__init__(self)
        self.model = model


class FakeTrainer:
    """What the callback looks at."""

    def __init__(self, folder: Path) -> None:
        self.global_step = 7
        self.loggers = [TensorBoardLogger(folder, name="", version="")]


def test_the_first_batch_of_a_validation_is_logged_though_it_has_no_poses(tmp_path: Path) -> None:
    truth = torch.full((4, 1, HEIGHT, WIDTH), 2.0)
    image = torch.rand(4, 3, HEIGHT, WIDTH)
    batch = Batch(image, image[:, None], truth, truth, truth, torch.eye(3).expand(4, 3, 3), None, ground_truth=truth)
    trainer, logger = FakeTrainer(tmp_path), PanelLogger(frames=2)
    for number in range(2):
        logger.on_validation_batch_end(trainer, Completion(Constant()), None, batch, number)  # type: ignore[arg-type]
    trainer.loggers[0].experiment.flush()
    events = EventAccumulator(str(tmp_path)).Reload()
    (image_event,) = events.Images("validation/frames")
    assert image_event.step == 7
    assert (image_event.height, image_event.width) == (2 * (HEIGHT + GAP) + GAP, 6 * (WIDTH + GAP) + GAP)
