"""Trajectories of several explorers on the same floor plan, side by side, as in Figure 3 of the paper."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure

from deux.figures.drawing import hide_ticks, new_figure
from deux.figures.trajectory import OCCUPANCY_COLORS, draw_path, draw_scale_bar, extent
from deux.geometry.grid import FreeSpace, GridFrame
from deux.mapping.occupancy import FREE, OCCUPIED, UNKNOWN

PANEL_WIDTH = 3.6  # inches


class Trajectory(NamedTuple):
    """Trajectory and final map of an episode, for one panel.

    Args:
        title: title of the panel.
        path: N x 2 world (x, z), in temporal order.
        frame: grid of `cells`.
        cells: rows x columns int8, final map: 0 unknown, 1 occupied, 2 free.
    """

    title: str
    path: np.ndarray
    frame: GridFrame
    cells: np.ndarray


def draw_trajectory_grid(plan: FreeSpace, trajectories: Sequence[Trajectory]) -> Figure:
    """Draw each trajectory in a separate panel, with obstacles in grey, explored floor in green and the rest in black.

    Args:
        plan: ground truth of the floor.
        trajectories: at least one trajectory.
    """
    columns = min(3, len(trajectories))
    rows = math.ceil(len(trajectories) / columns)
    height = PANEL_WIDTH * min(1.6, max(0.5, plan.frame.rows / plan.frame.columns)) + 0.3
    figure = new_figure(PANEL_WIDTH * columns + 0.8, height * rows)
    panels = figure.subplots(rows, columns, squeeze=False)
    longest = max(len(trajectory.path) for trajectory in trajectories)
    for panel in panels.flat[len(trajectories) :]:
        panel.set_axis_off()
    for panel, trajectory in zip(panels.flat, trajectories, strict=False):
        picture = explored_plan(plan, trajectory)
        panel.imshow(picture, cmap=OCCUPANCY_COLORS, vmin=0, vmax=2, extent=extent(plan.frame))
        hide_ticks(panel)
        draw_scale_bar(panel)
        path = draw_path(panel, trajectory.path)
        path.set_clim(0, max(1, longest - 1))
        panel.set_title(trajectory.title, fontsize=10)
    panels[0, 0].legend(loc="upper right", fontsize=7, framealpha=0.85)
    figure.colorbar(path, ax=list(panels.flat), fraction=0.03, pad=0.02).set_label("step")
    return figure


def explored_plan(plan: FreeSpace, trajectory: Trajectory) -> np.ndarray:
    """Floor plan, rows x columns int8: occupied at obstacles, free at explored cells, unknown elsewhere."""
    frame = plan.frame
    x = frame.origin_x + (np.arange(frame.columns) + 0.5) * frame.resolution
    z = frame.origin_z + (np.arange(frame.rows) + 0.5) * frame.resolution
    rows, columns = trajectory.frame.cells(*np.meshgrid(x, z))
    inside = trajectory.frame.contains(rows, columns)
    seen = np.zeros(frame.shape, bool)
    seen[inside] = trajectory.cells[rows[inside], columns[inside]] != UNKNOWN
    return np.where(plan.clearance <= 0.0, OCCUPIED, np.where(seen, FREE, UNKNOWN)).astype(np.int8)
