"""Top-down figure of a trajectory, coloured by time, over the explored map."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure

from deux.contracts import ExplorerMap
from deux.figures.drawing import TIME_COLORS, UNCERTAINTY_COLORS, hide_ticks, new_figure
from deux.geometry.grid import GridFrame

OCCUPANCY_COLORS = ListedColormap(["#101014", "#8a8f98", "#7fb98a"])
"""Unknown, occupied, free: black is unexplored and green explored, as in the paper's Figure 3."""

_MARGIN = 0.5


def draw_trajectory(explored: ExplorerMap, poses: np.ndarray, title: str = "") -> Figure:
    """Draw a trajectory over the explored map, and next to it the uncertainty field if there is one.

    Args:
        explored: the map; its grids are drawn in metres, x to the right and z downward.
        poses: N x 4 x 4 camera-to-world, in temporal order.
        title: title of the map.
    """
    with_field = explored.uncertainty is not None
    left, right, top, bottom = _drawn_part(explored, poses)
    height = 5.2 * min(1.5, max(0.6, (bottom - top) / (right - left)))
    figure = new_figure(6.6 * (2 if with_field else 1), height + 0.6)
    panels = figure.subplots(1, 2 if with_field else 1, squeeze=False)[0]
    for panel in panels:
        panel.imshow(explored.occupancy, cmap=OCCUPANCY_COLORS, vmin=0, vmax=2, extent=extent(explored.frame))
        panel.set(xlim=(left, right), ylim=(bottom, top))
        panel.set_facecolor(OCCUPANCY_COLORS(0))
        hide_ticks(panel)
        draw_scale_bar(panel)
    path = draw_path(panels[0], poses[:, [0, 2], 3])
    panels[0].legend(loc="upper right", fontsize=8, framealpha=0.85)
    figure.colorbar(path, ax=panels[0], fraction=0.046, pad=0.02).set_label("step")
    panels[0].set_title(title, fontsize=11)
    if explored.uncertainty is not None:
        field = panels[1].imshow(explored.uncertainty, cmap=UNCERTAINTY_COLORS, extent=extent(explored.frame))
        bar = figure.colorbar(field, ax=panels[1], fraction=0.046, pad=0.02)
        bar.set_label("uncertainty field")
        panels[1].plot(poses[:, 0, 3], poses[:, 2, 3], color="white", linewidth=0.7, alpha=0.7)
        panels[1].set_title("where the depth model is unsure", fontsize=11)
    return figure


def _drawn_part(explored: ExplorerMap, poses: np.ndarray) -> tuple[float, float, float, float]:
    """Bounds of the known cells and the trajectory (left, right, top, bottom)."""
    rows, columns = np.nonzero(explored.occupancy)
    frame = explored.frame
    xs = np.concatenate([frame.origin_x + columns * frame.resolution, poses[:, 0, 3]])
    zs = np.concatenate([frame.origin_z + rows * frame.resolution, poses[:, 2, 3]])
    return xs.min() - _MARGIN, xs.max() + _MARGIN, zs.min() - _MARGIN, zs.max() + _MARGIN


def extent(frame: GridFrame) -> tuple[float, float, float, float]:
    """Extent of a grid in metres for matplotlib's `imshow`: left, right, bottom, top."""
    right = frame.origin_x + frame.columns * frame.resolution
    bottom = frame.origin_z + frame.rows * frame.resolution
    return frame.origin_x, right, bottom, frame.origin_z


def draw_path(panel: Axes, points: np.ndarray) -> LineCollection:
    """Draw a path, N x 2 world (x, z), coloured by step, with markers at its start and end."""
    path = LineCollection(list(np.stack([points[:-1], points[1:]], axis=1)), cmap=TIME_COLORS, linewidths=2.0)
    path.set_array(np.arange(len(points) - 1))
    panel.add_collection(path, autolim=False)
    panel.plot(*points[0], "o", color="white", markeredgecolor="black", markersize=8, label="start")
    panel.plot(*points[-1], "s", color="white", markeredgecolor="black", markersize=8, label="end")
    return path


def draw_scale_bar(panel: Axes) -> None:
    """Draw a scale bar of one metre in the lower left corner of a panel, whose limits must be set."""
    left, right = panel.get_xlim()
    bottom, top = panel.get_ylim()
    x, z = left + 0.04 * (right - left), bottom + 0.05 * (top - bottom)
    panel.plot([x, x + 1.0], [z, z], color="white", linewidth=3, solid_capstyle="butt")
    panel.annotate("1 m", (x + 0.5, z), (0, 4), textcoords="offset points", color="white", ha="center", fontsize=8)
