"""Figures of predicted depth: a single depth map, or several frames with errors and photometric residuals."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from deux.contracts import Batch, DepthModel
from deux.figures.drawing import DEPTH_COLORS, ERROR_COLORS, UNCERTAINTY_COLORS, hide_ticks, new_figure
from deux.geometry.photometric_residual import photometric_residual
from deux.geometry.reprojection import reproject
from deux.inference.prediction import device_of

_COLUMNS = ("image", "sparse depth", "prediction", "ground truth", "error", "photometric residual")

_LONGER_SIDE = 7.0
"""Longer side of a single depth map without its colour bar, in inches."""

_MOST_ELONGATED = 4.0
"""Maximum aspect ratio of the area of a depth map."""


@dataclass(frozen=True)
class DepthSample:
    """One row of the figure of depth panels.

    Args:
        rgb: H x W x 3 uint8.
        sparse_depth: H x W metres, 0 = none.
        predicted_depth: H x W metres.
        ground_truth: H x W metres, 0 = none.
        residual: H x W photometric error in [0, 1], NaN where no source frame is valid.
    """

    rgb: np.ndarray
    sparse_depth: np.ndarray
    predicted_depth: np.ndarray
    ground_truth: np.ndarray
    residual: np.ndarray


@torch.no_grad()
def depth_samples(model: DepthModel, batch: Batch) -> list[DepthSample]:
    """Predict the depth of a batch with ground truth, and its photometric residuals, which are NaN without poses."""
    from lightning.fabric.utilities import move_data_to_device  # slow, and `draw_depth` needs none of it

    batch = move_data_to_device(batch, device_of(model))
    assert batch.ground_truth is not None
    predicted = model.predict(batch.image, batch.sparse_depth, batch.intrinsics)
    residual = torch.full_like(predicted[:, 0], torch.nan)
    if batch.source_from_target is not None:
        images, visible = reproject(batch.sources, predicted, batch.intrinsics, batch.source_from_target)
        residual = photometric_residual(batch.image, images, visible)
    return [
        DepthSample(
            rgb=(batch.image[i].permute(1, 2, 0) * 255.0).round().byte().cpu().numpy(),
            sparse_depth=batch.sparse_depth[i, 0].cpu().numpy(),
            predicted_depth=predicted[i, 0].cpu().numpy(),
            ground_truth=batch.ground_truth[i, 0].cpu().numpy(),
            residual=residual[i].cpu().numpy(),
        )
        for i in range(len(batch.image))
    ]


class Scales(NamedTuple):
    """Upper limits of the colour scales; all begin at 0.

    Args:
        depth: metres.
        error: metres.
        residual: photometric error.
    """

    depth: float
    error: float
    residual: float


def depth_scales(samples: Sequence[DepthSample]) -> Scales:
    """Common colour scales of several samples, from high percentiles of their values."""
    errors = [np.abs(known(sample.ground_truth) - sample.predicted_depth) for sample in samples]
    return Scales(
        depth=_percentile([sample.ground_truth for sample in samples], 98, least=1.0),
        error=_percentile(errors, 95, least=0.05),
        residual=_percentile([sample.residual for sample in samples], 98, least=0.02),
    )


def known(depth: np.ndarray) -> np.ndarray:
    """Replace 0 in depth by NaN, so that "none" is drawn as background."""
    return np.where(depth > 0, depth, np.nan)


def draw_depth_panels(samples: Sequence[DepthSample]) -> Figure:
    """Draw one row for each sample, with common colour scales for depth, error and residual.

    Depth runs from 0 to the 98th percentile of the ground truth. The error is absolute, in metres; the residual is
    the per-pixel photometric error whose mean enters Eq. 8, whichever measure of uncertainty guides the robot.
    """
    deepest, worst, largest = depth_scales(samples)
    height, width = samples[0].rgb.shape[:2]
    figure = new_figure(1.9 * len(_COLUMNS), 1.95 * len(samples) * height / width + 0.9)
    grid = figure.add_gridspec(len(samples) + 1, len(_COLUMNS), height_ratios=[1.0] * len(samples) + [0.06])
    for row, sample in enumerate(samples):
        panels = [figure.add_subplot(grid[row, column]) for column in range(len(_COLUMNS))]
        panels[0].imshow(sample.rgb)
        _draw_sparse(panels[1], sample.sparse_depth, deepest)
        panels[2].imshow(sample.predicted_depth, cmap=DEPTH_COLORS, vmin=0.0, vmax=deepest)
        depth = panels[3].imshow(known(sample.ground_truth), cmap=DEPTH_COLORS, vmin=0.0, vmax=deepest)
        error = np.abs(known(sample.ground_truth) - sample.predicted_depth)
        wrong = panels[4].imshow(error, cmap=ERROR_COLORS, vmin=0.0, vmax=worst)
        residual = panels[5].imshow(sample.residual, cmap=UNCERTAINTY_COLORS, vmin=0.0, vmax=largest)
        for panel, title in zip(panels, _COLUMNS, strict=True):
            panel.set_facecolor("0.85")
            hide_ticks(panel)
            panel.set_title(title if row == 0 else "", fontsize=10)
    bars = ((slice(1, 4), depth, "depth [m]"), (4, wrong, "|error| [m]"), (5, residual, "L1 of the images"))
    for columns, image, label in bars:
        bar = figure.colorbar(image, cax=figure.add_subplot(grid[-1, columns]), orientation="horizontal")
        bar.set_label(label, fontsize=9)
        bar.ax.tick_params(labelsize=8)
    return figure


def draw_depth(depth: np.ndarray, confidence: np.ndarray | None = None) -> Figure:
    """Draw a depth map with a scale in metres, and optionally its confidence.

    The colours range from the 1st to the 99th percentile.

    Args:
        depth: H x W metres, 0 = none.
        confidence: H x W in [0, 1], 0 = none; None for no second map.
    """
    nearest, farthest = np.percentile(depth[depth > 0], (1, 99)) if (depth > 0).any() else (0.0, 1.0)
    maps = [(known(depth), DEPTH_COLORS, (nearest, farthest), "depth [m]", "both")]
    if confidence is not None:
        maps.append((known(confidence), UNCERTAINTY_COLORS, (0.0, 1.0), "confidence", "neither"))
    height, width = depth.shape
    ratio = min(max(height / width, 1 / _MOST_ELONGATED), _MOST_ELONGATED)
    size = _LONGER_SIDE * np.array([1.0, ratio]) / max(1.0, ratio)
    figure = new_figure(len(maps) * (size[0] + 1.0), size[1])
    for number, (values, colors, (low, high), label, extend) in enumerate(maps, start=1):
        axes = figure.add_subplot(1, len(maps), number)
        picture = axes.imshow(values, cmap=colors, vmin=low, vmax=high)
        axes.set_facecolor("0.85")
        hide_ticks(axes)
        bar = figure.colorbar(picture, ax=axes, extend=extend, pad=0.02)
        bar.set_label(label, fontsize=9)
        bar.ax.tick_params(labelsize=8)
    return figure


def _draw_sparse(panel: Axes, sparse_depth: np.ndarray, deepest: float) -> None:
    """Draw sparse points as discs, since single pixels would be too small in print."""
    rows, columns = np.nonzero(sparse_depth)
    panel.imshow(np.full(sparse_depth.shape, np.nan))  # sets limits and aspect as in the other panels
    panel.scatter(
        columns,
        rows,
        c=sparse_depth[rows, columns],
        s=3.0,
        cmap=DEPTH_COLORS,
        vmin=0.0,
        vmax=deepest,
        linewidths=0,
    )


def _percentile(maps: Sequence[np.ndarray], percent: float, least: float) -> float:
    values = np.concatenate([values[np.isfinite(values) & (values > 0)] for values in maps])
    return max(least, float(np.percentile(values, percent))) if values.size else least
