"""Preview figure of recorded frames: image, sparse depth, ground truth and reconstruction."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure

from deux.figures.drawing import DEPTH_COLORS, hide_ticks, new_figure

_COLUMNS = ("image", "sparse depth", "ground truth", "rebuilt from the neighbour")


class PreviewFrame(NamedTuple):
    """One row of the preview.

    Args:
        name: name of the frame.
        image: H x W x 3 uint8.
        sparse_depth: H x W metres, 0 = none.
        ground_truth: H x W metres, 0 = none; None for no ground truth.
        rebuilt: reconstruction from a neighbouring frame, H x W x 3, 0-255, NaN where invalid; None for none.
    """

    name: str
    image: np.ndarray
    sparse_depth: np.ndarray
    ground_truth: np.ndarray | None
    rebuilt: np.ndarray | None


def draw_preview(frames: Sequence[PreviewFrame]) -> Figure:
    """Draw one row for each frame, with a common depth scale up to the 98th percentile."""
    depths = [
        depth[depth > 0] for frame in frames for depth in (frame.sparse_depth, frame.ground_truth) if depth is not None
    ]
    values = np.concatenate(depths)
    deepest = float(np.percentile(values, 98)) if values.size else 1.0
    height, width = frames[0].image.shape[:2]
    figure = new_figure(2.6 * len(_COLUMNS), 2.7 * len(frames) * height / width + 0.9)
    grid = figure.add_gridspec(len(frames) + 1, len(_COLUMNS), height_ratios=[1.0] * len(frames) + [0.06])
    for row, frame in enumerate(frames):
        panels = [figure.add_subplot(grid[row, column]) for column in range(len(_COLUMNS))]
        for panel, title in zip(panels, _COLUMNS, strict=True):
            panel.set_facecolor("0.85")
            panel.imshow(np.full((*frame.image.shape[:2], 4), 0.0))  # sets limits and aspect
            hide_ticks(panel)
            panel.set_title(title if row == 0 else "", fontsize=10)
        panels[0].imshow(frame.image)
        panels[0].set_ylabel(frame.name, fontsize=7)
        rows, columns = np.nonzero(frame.sparse_depth)
        points = frame.sparse_depth[rows, columns]
        shown = panels[1].scatter(columns, rows, c=points, s=2.0, cmap=DEPTH_COLORS, vmin=0.0, vmax=deepest)
        if frame.ground_truth is not None:
            known = np.where(frame.ground_truth > 0, frame.ground_truth, np.nan)
            panels[2].imshow(known, cmap=DEPTH_COLORS, vmin=0.0, vmax=deepest)
        if frame.rebuilt is not None:
            seen = np.isfinite(frame.rebuilt).all(axis=-1)
            colors = np.where(seen[..., None], frame.rebuilt, 217.0)
            panels[3].imshow(colors.astype(np.uint8))
    bar = figure.colorbar(shown, cax=figure.add_subplot(grid[-1, 1:3]), orientation="horizontal")
    bar.set_label("depth [m]", fontsize=9)
    bar.ax.tick_params(labelsize=8)
    return figure
