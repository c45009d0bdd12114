"""One depth map in colours, with the scale to read them by."""

import numpy as np
from matplotlib.figure import Figure

from deux.figures.drawing import DEPTH_COLORS, hide_ticks, new_figure

_LONGER_SIDE = 7.0
"""Of the picture without its scale, in inches."""

_MOST_ELONGATED = 4.0
"""Ratio of the sides from which on the map stands in an area that is wider or higher than itself."""


def draw_depth(depth: np.ndarray) -> Figure:
    """Draw a depth map with a scale in metres.

    The colours run from the 1st to the 99th percentile, so that a few far pixels do not flatten all others.

    Args:
        depth: H x W metres, 0 = none.
    """
    known = np.where(depth > 0, depth, np.nan)
    nearest, farthest = np.nanpercentile(known, (1, 99)) if (depth > 0).any() else (0.0, 1.0)
    height, width = depth.shape
    ratio = min(max(height / width, 1 / _MOST_ELONGATED), _MOST_ELONGATED)
    size = _LONGER_SIDE * np.array([1.0, ratio]) / max(1.0, ratio)
    figure = new_figure(size[0] + 1.0, size[1])
    axes = figure.add_subplot()
    picture = axes.imshow(known, cmap=DEPTH_COLORS, vmin=nearest, vmax=farthest)
    axes.set_facecolor("0.85")
    hide_ticks(axes)
    bar = figure.colorbar(picture, ax=axes, extend="both", pad=0.02)
    bar.set_label("depth [m]", fontsize=9)
    bar.ax.tick_params(labelsize=8)
    return figure
