"""Lightning callback that logs predictions as images to TensorBoard."""

from collections.abc import Sequence
from typing import Any

import matplotlib
import numpy as np
import torch
from lightning.pytorch import Callback, LightningModule, Trainer
from lightning.pytorch.loggers import TensorBoardLogger
from torch import Tensor
from torchvision.utils import make_grid

from deux.contracts import Batch
from deux.figures.depth_figures import DepthSample, depth_samples, depth_scales, known
from deux.figures.drawing import DEPTH_COLORS, ERROR_COLORS, UNCERTAINTY_COLORS
from deux.geometry.sliding_max import sliding_max
from deux.training.module import DepthCompletion

_BACKGROUND = 0.85
"""Grey level of pixels without a value."""

_POINT = 3
"""Size of a sparse point in pixels, since single pixels are hard to see."""


class PanelLogger(Callback):
    """Log the first frames of each validation to TensorBoard, one row for each frame; see `panel_grid`.

    Args:
        frames: number of frames, at most the batch size.
    """

    def __init__(self, frames: int = 3) -> None:
        self.frames = frames

    def on_validation_batch_end(
        self,
        trainer: Trainer,
        pl_module: LightningModule,
        outputs: Any,
        batch: Batch,
        batch_idx: int,
        dataloader_idx: int = 0,
    ) -> None:
        """Log the first batch."""
        if batch_idx > 0 or batch.ground_truth is None or not isinstance(pl_module, DepthCompletion):
            return
        grid = panel_grid(depth_samples(pl_module.model, batch)[: self.frames])
        for logger in trainer.loggers:
            if isinstance(logger, TensorBoardLogger):
                logger.experiment.add_image("validation/frames", grid, trainer.global_step)


def panel_grid(samples: Sequence[DepthSample]) -> Tensor:
    """One row for each sample: image, sparse depth, prediction, ground truth, absolute error, photometric residual.

    The colours are those of `draw_depth_panels`; depth, error and residual have common scales for all rows.

    Args:
        samples: at least one sample, all of the same size.

    Returns:
        3 x height x width float32 in [0, 1].
    """
    scales = depth_scales(samples)
    panels = []
    for sample in samples:
        points = sliding_max(torch.from_numpy(sample.sparse_depth)[None, None], _POINT)[0, 0].numpy()
        truth = known(sample.ground_truth)
        panels += [
            torch.from_numpy(sample.rgb).permute(2, 0, 1).float() / 255.0,
            _colored(known(points), DEPTH_COLORS, scales.depth),
            _colored(sample.predicted_depth, DEPTH_COLORS, scales.depth),
            _colored(truth, DEPTH_COLORS, scales.depth),
            _colored(np.abs(truth - sample.predicted_depth), ERROR_COLORS, scales.error),
            _colored(sample.residual, UNCERTAINTY_COLORS, scales.residual),
        ]
    return make_grid(panels, nrow=len(panels) // len(samples), pad_value=1.0)


def _colored(values: np.ndarray, colors: str, most: float) -> Tensor:
    """Apply a colour map to H x W values from 0 to `most`; returns 3 x H x W, grey where values are NaN."""
    pixels = matplotlib.colormaps[colors](np.clip(values / most, 0.0, 1.0))[..., :3]
    pixels[np.isnan(values)] = _BACKGROUND
    return torch.from_numpy(pixels.astype(np.float32)).permute(2, 0, 1)
