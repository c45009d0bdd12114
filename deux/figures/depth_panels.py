"""The figure that shows a model at work: image, sparse depth, prediction, ground truth, error, uncertainty."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from deux.figures.drawing import DEPTH_COLORS, ERROR_COLORS, UNCERTAINTY_COLORS, hide_ticks, new_figure

_COLUMNS = ("image", "sparse depth", "prediction", "ground truth", "error", "uncertainty")


@dataclass(frozen=True)
class DepthSample:
    """One row of the figure.

    Args:
        rgb: H x W x 3 uint8.
        sparse_depth: H x W metres, 0 = none.
        predicted_depth: H x W metres.
        ground_truth: H x W metres, 0 = none.
        residual: H x W photometric error in [0, 1], NaN where no source frame sees the pixel.
    """

    rgb: np.ndarray
    sparse_depth: np.ndarray
    predicted_depth: np.ndarray
    ground_truth: np.ndarray
    residual: np.ndarray


class Scales(NamedTuple):
    """Where the colours of each kind of panel end; all begin at 0.

    Args:
        depth: metres.
        error: metres.
        residual: photometric error.
    """

    depth: float
    error: float
    residual: float


def depth_scales(samples: Sequence[DepthSample]) -> Scales:
    """The scales that several samples share: high percentiles of what they show."""
    errors = [np.abs(known(sample.ground_truth) - sample.predicted_depth) for sample in samples]
    return Scales(
        depth=_percentile([sample.ground_truth for sample in samples], 98, least=1.0),
        error=_percentile(errors, 95, least=0.05),
        residual=_percentile([sample.residual for sample in samples], 98, least=0.02),
    )


def known(depth: np.ndarray) -> np.ndarray:
    """Depth with NaN instead of 0, so that "none" is drawn as the background."""
    return np.where(depth > 0, depth, np.nan)


def draw_depth_panels(samples: Sequence[DepthSample]) -> Figure:
    """Draw one row for each sample; depth, error and uncertainty share one colour scale each over all rows.

    Depth runs from 0 to the 98th percentile of the ground truth. The error is absolute, in metres; the uncertainty is
    the per-pixel photometric residual whose mean enters Eq. 8.
    """
    deepest, worst, most_unsure = depth_scales(samples)
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
        unsure = panels[5].imshow(sample.residual, cmap=UNCERTAINTY_COLORS, vmin=0.0, vmax=most_unsure)
        for panel, title in zip(panels, _COLUMNS, strict=True):
            panel.set_facecolor("0.85")
            hide_ticks(panel)
            panel.set_title(title if row == 0 else "", fontsize=10)
    bars = ((slice(1, 4), depth, "depth [m]"), (4, wrong, "|error| [m]"), (5, unsure, "photometric residual"))
    for columns, image, label in bars:
        bar = figure.colorbar(image, cax=figure.add_subplot(grid[-1, columns]), orientation="horizontal")
        bar.set_label(label, fontsize=9)
        bar.ax.tick_params(labelsize=8)
    return figure


def _draw_sparse(panel: Axes, sparse_depth: np.ndarray, deepest: float) -> None:
    """Points as discs: at 1 % density single pixels would vanish in print."""
    rows, columns = np.nonzero(sparse_depth)
    panel.imshow(np.full(sparse_depth.shape, np.nan))  # fixes limits and aspect as the neighbours have them
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
