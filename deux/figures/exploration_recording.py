"""Recordings of an exploration episode for the Rerun viewer: images, maps and targets of each step."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from deux.collection.explored_map import map_of
from deux.collection.walk import Step
from deux.contracts import ExplorerMap
from deux.figures.depth_video import color_map
from deux.figures.drawing import UNCERTAINTY_COLORS
from deux.figures.trajectory import OCCUPANCY_COLORS
from deux.figures.viewer_recording import FRAME_TIMELINE, ViewerFile, rerun_package
from deux.geometry.grid import GridFrame
from deux.geometry.poses import yaw_of
from deux.mapping.frontiers import frontier_mask
from deux.mapping.occupancy import OccupancyMap

if TYPE_CHECKING:
    from rerun.blueprint import Blueprint

_PALETTE = np.rint(255.0 * OCCUPANCY_COLORS(np.arange(3))[:, :3]).astype(np.uint8)
_PATH, _FRONTIER, _TARGET = (255, 255, 255), (255, 200, 60), (230, 60, 60)
"""Colours on the map."""

_MARGIN = 5
"""Margin around the floor plan in cells."""


class _Moment(NamedTuple):
    """Map and robot pose (world x, z and heading) of one step."""

    explored: ExplorerMap
    x: float
    z: float
    yaw: float


class ExplorationRecording:
    """Recording of one episode. A context manager that writes the maps at its end, since they grow.

        image, depth        camera image, and the depth from which the map is built
        map                 floor plan: black unknown, grey occupied, green free
        map/path, /robot    trajectory and current pose
        map/frontiers       free cells next to unknown ones
        map/target          target of the explorer
        field               uncertainty field of the explorer on the same plan, if it has one
        uncertainty         uncertainty of each frame (Eq. 8), if the explorer uses it

    For explorers without a map, a map is built from the ground truth depth.

    Args:
        path: the .rrd file.
        name: name of the episode.
    """

    def __init__(self, path: Path, name: str) -> None:
        self.path = path
        self._rerun: Any = rerun_package()
        self._file = ViewerFile(path, name, _layout())
        self._moments: list[_Moment] = []
        self._true_map: OccupancyMap | None = None

    def __enter__(self) -> "ExplorationRecording":
        self._file.__enter__()
        return self

    def __exit__(self, kind: type[BaseException] | None, *details: object) -> None:
        if kind is None and self._moments:
            self._log_maps()
        self._file.__exit__(kind, *details)

    def add(self, step: Step) -> None:
        """Record a step, before the explorer chooses the next action."""
        rerun, stream = self._rerun, self._file.stream
        stream.set_time(FRAME_TIMELINE, sequence=step.number)
        stream.log("image", rerun.Image(step.frame.rgb).compress(jpeg_quality=85))
        depth, percept = step.frame.depth, step.percept
        if percept is not None:
            depth = percept.predicted_depth.cpu().numpy()
            if percept.uncertainty is not None and math.isfinite(percept.uncertainty):
                stream.log("uncertainty", rerun.Scalars(float(percept.uncertainty)))
        millimetres = np.clip(np.rint(1000.0 * np.nan_to_num(depth)), 0, 65535).astype(np.uint16)
        stream.log("depth", rerun.DepthImage(millimetres, meter=1000.0, colormap="turbo"))
        pose = step.frame.pose
        moment = _Moment(self._explored(step), float(pose[0, 3]), float(pose[2, 3]), yaw_of(pose))
        self._moments.append(moment)

    def _explored(self, step: Step) -> ExplorerMap:
        known = map_of(step.walk.explorer)
        if known is not None:
            return known
        if self._true_map is None:
            self._true_map = OccupancyMap(step.walk.simulator.camera, step.walk.simulator.robot)
        self._true_map.update(step.frame.depth, step.frame.pose)
        return ExplorerMap(self._true_map.frame, self._true_map.cells.copy())

    def _log_maps(self) -> None:
        """Log all floor plans on one canvas with one pixel per cell."""
        rerun, stream = self._rerun, self._file.stream
        canvas = _canvas(self._moments)
        values = [moment.explored.uncertainty for moment in self._moments]
        known = np.concatenate([field[np.isfinite(field)] for field in values if field is not None] or [np.zeros(1)])
        highest = float(np.percentile(known, 99)) if known.size else 1.0
        path: list[tuple[float, float]] = []
        for number, (explored, x, z, yaw) in enumerate(self._moments):
            stream.set_time(FRAME_TIMELINE, sequence=number)
            cells = _on_canvas(explored.occupancy, explored.frame, canvas, 0)
            stream.log("map", rerun.Image(_PALETTE[cells]))
            path.append(_pixel(canvas, x, z))
            stream.log("map/path", rerun.LineStrips2D([path], colors=[_PATH], radii=0.5))
            heading = (-4.0 * math.sin(yaw), -4.0 * math.cos(yaw))
            stream.log("map/robot", rerun.Arrows2D(origins=[path[-1]], vectors=[heading], colors=[_TARGET], radii=0.8))
            rows, columns = np.nonzero(frontier_mask(cells))
            places = np.stack([columns, rows], axis=1) + 0.5
            stream.log("map/frontiers", rerun.Points2D(places, colors=[_FRONTIER], radii=0.6))
            target = [] if explored.target is None else [_pixel(canvas, *explored.target)]
            stream.log("map/target", rerun.Points2D(target, colors=[_TARGET], radii=3.0))
            if explored.uncertainty is not None:
                field = _on_canvas(explored.uncertainty, explored.frame, canvas, np.nan)
                stream.log("field", rerun.Image(color_map(field, (0.0, highest), UNCERTAINTY_COLORS)))


def _canvas(moments: Sequence[_Moment]) -> GridFrame:
    """The smallest grid that contains all known cells of all steps with a margin of `_MARGIN` cells."""
    cell = moments[0].explored.frame.resolution
    ends = []
    for explored, x, z, _ in moments:
        rows, columns = np.nonzero(explored.occupancy)
        known = np.stack([explored.frame.origin_x + columns * cell, explored.frame.origin_z + rows * cell], axis=1)
        ends += [known.min(axis=0), known.max(axis=0) + cell] if len(known) else [np.array([x, z])]
    low, high = np.min(ends, axis=0), np.max(ends, axis=0)
    first = moments[0].explored.frame
    # Aligned with the cells of the maps, which grow by whole cells.
    left = first.origin_x + cell * (round((low[0] - first.origin_x) / cell) - _MARGIN)
    top = first.origin_z + cell * (round((low[1] - first.origin_z) / cell) - _MARGIN)
    rows, columns = (round((high[axis] - low[axis]) / cell) + 2 * _MARGIN for axis in (1, 0))
    return GridFrame(left, top, rows, columns, cell)


def _on_canvas(values: np.ndarray, frame: GridFrame, canvas: GridFrame, empty: float) -> np.ndarray:
    """Copy the values of a grid to the canvas, with `empty` elsewhere; values outside of the canvas are ignored."""
    result = np.full(canvas.shape, empty, values.dtype)
    row = round((frame.origin_z - canvas.origin_z) / canvas.resolution)
    column = round((frame.origin_x - canvas.origin_x) / canvas.resolution)
    top, left = max(0, row), max(0, column)
    bottom, right = min(canvas.rows, row + frame.rows), min(canvas.columns, column + frame.columns)
    result[top:bottom, left:right] = values[top - row : bottom - row, left - column : right - column]
    return result


def _pixel(canvas: GridFrame, x: float, z: float) -> tuple[float, float]:
    """Pixel coordinates of a world position in metres."""
    return (x - canvas.origin_x) / canvas.resolution, (z - canvas.origin_z) / canvas.resolution


def _layout() -> "Blueprint":
    """Viewer layout: camera on the left, floor plan in the middle, uncertainty on the right."""
    from rerun import blueprint

    return blueprint.Blueprint(
        blueprint.Horizontal(
            blueprint.Vertical(
                blueprint.Spatial2DView(origin="image", name="image"),
                blueprint.Spatial2DView(origin="depth", name="depth"),
            ),
            blueprint.Spatial2DView(origin="map", name="map, path, frontiers and target"),
            blueprint.Vertical(
                blueprint.Spatial2DView(origin="field", name="uncertainty field"),
                blueprint.TimeSeriesView(origin="uncertainty", name="uncertainty of the frames"),
            ),
            column_shares=[1, 2, 1],
        ),
        collapse_panels=True,
    )
