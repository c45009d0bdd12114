"""Top-down occupancy grid of the floor, built from depth images and poses (Sec. III.D of the paper)."""

import math
from dataclasses import dataclass

import numpy as np

from deux.compilation import compiled
from deux.contracts import Robot
from deux.geometry.camera import Camera
from deux.geometry.grid import GridFrame
from deux.mapping.growing_grid import GrowingGrid

UNKNOWN, OCCUPIED, FREE = 0, 1, 2


@dataclass(frozen=True)
class DepthTolerance:
    """Errors of a depth image that a map of the floor allows for.

    A relative error moves a point along its ray. It lifts a point of the floor by `relative` x camera height at any
    distance, and moves a wall by `relative` x distance.

    Args:
        relative: typical relative error of the depth; 0 for an exact sensor.
        border: pixels along the image's edges that are not used, at most an eighth of the image. The padding of its
            convolutions makes a network's depth wrong there, and the lowest rows show the floor before the robot.
        incidence: degrees between the line of sight and a surface's normal above which its pixels are not used. A
            network blurs the step from a near to a far surface into a steep ramp, where there is no surface.
        visited_is_free: whether cells that the robot's body has been on stay free, whatever later depth images show.
    """

    relative: float = 0.0
    border: int = 0
    incidence: float = 90.0
    visited_is_free: bool = False


EXACT = DepthTolerance()
"""Errors of a simulated depth sensor: none."""

PREDICTED = DepthTolerance(relative=0.1, border=6)
"""Assumed errors of predicted depth if they are not measured.

After 300 training steps, a model's error is below 20 % in 90 % of the floor's pixels, so `relative` is 0.1. In the
outermost rows and columns, its depth is 0.25 to 0.8 of the true one, which would surround the robot with false
obstacles at half a metre.
"""

# The change of a cell's log-odds of being occupied by one frame, and their limits, which allow later frames to correct
# earlier ones. In a cell with hits, free floor in the same frame is ignored, so a hit weighs less than free floor.
# With a relative depth error of 10 % (standard deviation, smooth over the image), the frontier explorer maps 83 % of a
# flat's floor as free; with OctoMap's 0.85 and -0.4 it maps 68 %, and with an error of 15 % obstacles surround it.
HIT, SEEN_FREE = 0.6, -0.8
LEAST, MOST = -2.0, 3.5
# The log-odds of an obstacle that the robot has collided with; they are not changed by any frame.
CONTACT = 100.0
# The change for a cell in the blind zone in front of the robot, whose floor no pixel shows, but above which a ray
# passed: it becomes free if it was unknown, and one hit outweighs it.
PASSED_OVER = -0.1

# What a pixel shows. BELOW is a hole in the floor; BEYOND is out of range or higher than the robot.
_NOTHING, _BEYOND, _BELOW, _FLOOR, _OBSTACLE = 0, 1, 2, 3, 4


class OccupancyMap:
    """Top-down occupancy grid with log-odds, which grows with the known part of the floor.

    A pixel between `robot.max_climb` and `robot.height` above the floor is a hit of its cell. A cell is seen free if
    its floor point projects to a pixel that shows floor or a surface behind the point. Each frame changes a cell's
    log-odds once (a hit takes precedence over free floor), so that later frames correct errors of predicted depth. The
    floor is `robot.camera_height` below the camera, which is level.

    Errors of the depth (`errors`) have two effects. The minimal height of an obstacle is increased by the height by
    which the error can lift the floor. And the weight of a hit is reduced, since the point may lie in other cells along
    its ray: it is multiplied by the width of a cell divided by this width plus the error at that distance, so that one
    near view outweighs several far ones. Free floor is not reweighted, since it is seen along the whole ray.

    Args:
        camera: the camera that the depth images come from.
        robot: its `max_climb` and `height` bound the obstacles; its footprint is free.
        resolution: edge of a cell in metres.
        max_range: distance along the floor in metres up to which depth is used.
        errors: errors of the depth images.
    """

    def __init__(
        self,
        camera: Camera,
        robot: Robot,
        resolution: float = 0.05,
        max_range: float = 3.0,
        errors: DepthTolerance = EXACT,
    ) -> None:
        self.camera = camera
        self.robot = robot
        self.resolution = resolution
        self.max_range = max_range
        self.errors = errors
        layers: dict[str, type] = {"log_odds": np.float32, "cells": np.int8}
        layers |= {"views": np.int32, "seen": np.bool_, "visited": np.bool_, "trace": np.bool_}
        self._grid = GrowingGrid(resolution, layers)
        self._position: tuple[float, float] | None = None

    @property
    def cells(self) -> np.ndarray:
        """Rows x columns int8: 0 unknown, 1 occupied, 2 free."""
        return self._grid["cells"]

    @property
    def views(self) -> np.ndarray:
        """Rows x columns int32: the number of frames that changed each cell's log-odds."""
        return self._grid["views"]

    @property
    def seen(self) -> np.ndarray:
        """Rows x columns bool: the cells whose log-odds the last frame changed."""
        return self._grid["seen"]

    @property
    def visited(self) -> np.ndarray:
        """Rows x columns bool: the cells within the robot's radius of its positions."""
        return self._grid["visited"]

    @property
    def trace(self) -> np.ndarray:
        """Rows x columns bool: the cells under the path of the robot's centre, three cells wide.

        Recorded if `errors.visited_is_free`; otherwise empty.
        """
        return self._grid["trace"]

    @property
    def frame(self) -> GridFrame:
        """Position, size and resolution of the grid."""
        return self._grid.frame

    def update(self, depth: np.ndarray, pose: np.ndarray, relative_error: float | None = None) -> None:
        """Add one frame.

        Args:
            depth: H x W float, metres along the optical axis, 0 or NaN = none.
            pose: 4 x 4 camera-to-world.
            relative_error: relative error of this frame's depth; None for `errors.relative`.
        """
        relative = self.errors.relative if relative_error is None else relative_error
        x, z = float(pose[0, 3]), float(pose[2, 3])
        self._grid.cover(x, z, self.max_range + self.resolution)
        frame = self.frame
        rows, columns = depth.shape
        k, border = self.camera.intrinsics, min(self.errors.border, rows // 8, columns // 8)
        lens = (k[0, 0], k[0, 2] - border, k[1, 2] - border)
        lattice = (frame.origin_x, frame.origin_z, self.resolution)
        floor = float(pose[1, 3]) - self.robot.camera_height
        depth = np.ascontiguousarray(depth[border : rows - border, border : columns - border], np.float32)
        if self.errors.incidence < 90.0:
            depth = _without_ramps(depth, 1.0 + 2.0 * math.tan(math.radians(self.errors.incidence)) / k[0, 0])
        pose = np.ascontiguousarray(pose, np.float64)
        lifted = relative * self.robot.camera_height
        band = (self.robot.max_climb + lifted, self.robot.height)
        kinds, ranges, hits = _classify(depth, pose, lens, floor, band, self.max_range, lattice, frame.shape)
        _relabel_feet(kinds, depth, hits, pose, lens, lattice)
        self.seen.fill(False)
        if self.errors.visited_is_free:
            hits[self.visited | self.trace] = 0
        evidence = (self._grid["log_odds"], self.cells, self.views, self.seen)
        _gather(kinds, ranges, hits, pose, lens, floor, self.max_range, lattice, relative, *evidence)
        window, inside = self._disc(x, z, self.robot.radius)
        self._set(window, inside, LEAST)
        self.visited[window][inside] = True
        if self.errors.visited_is_free:
            self._extend_trace(x, z)

    def mark_contact(self, pose: np.ndarray) -> None:
        """Add an obstacle that the robot has collided with, straight ahead; later frames do not remove it."""
        distance = self.robot.radius + 1.5 * self.resolution
        forward = pose[[0, 2], 2] / np.linalg.norm(pose[[0, 2], 2])
        x, z = pose[[0, 2], 3] + forward * distance
        self._set(*self._disc(float(x), float(z), self.resolution), CONTACT)
        self._set(*self._disc(float(pose[0, 3]), float(pose[2, 3]), self.robot.radius), LEAST)

    def _extend_trace(self, x: float, z: float) -> None:
        """Add the straight way from the last position to (x, z) to the trace, as free cells."""
        start_x, start_z = self._position or (x, z)
        self._position = x, z
        pieces = 1 + math.ceil(2.0 * math.hypot(x - start_x, z - start_z) / self.resolution)
        rows, columns = self.frame.cells(np.linspace(start_x, x, pieces), np.linspace(start_z, z, pieces))
        down, right = np.mgrid[-1:2, -1:2].reshape(2, 9, 1)
        passed = rows + down, columns + right
        self.trace[passed] = True
        self._grid["log_odds"][passed] = LEAST
        self.cells[passed] = FREE

    def _disc(self, x: float, z: float, radius: float) -> tuple[tuple[slice, slice], np.ndarray]:
        """A window of the grid, and which of its cells contain (x, z) or have their centre within `radius` of it."""
        frame = self.frame
        row, column = frame.cell(x, z)
        reach = math.ceil(radius / self.resolution)
        window = np.s_[max(0, row - reach) : row + reach + 1, max(0, column - reach) : column + reach + 1]
        rows, columns = np.mgrid[window]
        centre_x = frame.origin_x + (columns + 0.5) * self.resolution
        centre_z = frame.origin_z + (rows + 0.5) * self.resolution
        inside = (np.hypot(centre_x - x, centre_z - z) <= radius) | ((rows == row) & (columns == column))
        return window, inside

    def _set(self, window: tuple[slice, slice], inside: np.ndarray, log_odds: float) -> None:
        """Set the log-odds of some cells of a window."""
        self._grid["log_odds"][window][inside] = log_odds
        self.cells[window][inside] = OCCUPIED if log_odds > 0 else FREE


@compiled
def _without_ramps(depth, most):  # type: ignore[no-untyped-def]
    """The depth, 0 where the farthest of a pixel and its eight neighbours exceeds `most` times the nearest."""
    kept = depth.copy()
    height, width = depth.shape
    for v in range(height):
        for u in range(width):
            near, far = math.inf, 0.0
            for row in range(max(0, v - 1), min(height, v + 2)):
                for column in range(max(0, u - 1), min(width, u + 2)):
                    d = depth[row, column]
                    if d > 0.0:
                        near, far = min(near, d), max(far, d)
            if far > most * near:
                kept[v, u] = 0.0
    return kept


@compiled
def _classify(depth, pose, lens, floor, band, max_range, lattice, shape):  # type: ignore[no-untyped-def]
    """What each pixel shows, its distance along the floor, and the cells that contain obstacles."""
    f, cx, cy = lens
    low, high = band
    origin_x, origin_z, resolution = lattice
    height, width = depth.shape
    kinds = np.zeros((height, width), np.uint8)
    ranges = np.zeros((height, width), np.float32)
    hits = np.zeros(shape, np.uint8)
    for v in range(height):
        b = (v - cy) / f
        before_x, before_z, before_depth = 0.0, 0.0, 0.0
        for u in range(width):
            d = depth[v, u]
            if not d > 0.0:
                before_depth = 0.0
                continue
            a = (u - cx) / f
            dx = (pose[0, 0] * a + pose[0, 1] * b + pose[0, 2]) * d
            dz = (pose[2, 0] * a + pose[2, 1] * b + pose[2, 2]) * d
            above = (pose[1, 0] * a + pose[1, 1] * b + pose[1, 2]) * d + pose[1, 3] - floor
            distance = math.sqrt(dx * dx + dz * dz)
            ranges[v, u] = distance
            if distance > max_range or above > high:
                kinds[v, u] = _BEYOND
            elif above < -low:
                kinds[v, u] = _BELOW
            elif above < low:
                kinds[v, u] = _FLOOR
            else:
                kinds[v, u] = _OBSTACLE
            if kinds[v, u] != _OBSTACLE:
                before_depth = 0.0
                continue
            x, z = pose[0, 3] + dx, pose[2, 3] + dz
            hits[int((z - origin_z) / resolution), int((x - origin_x) / resolution)] = 1
            # Neighbouring pixels of a far surface, or of one at a grazing angle, are more than a cell apart: fill the
            # cells between them, except at depth discontinuities.
            gap = max(abs(x - before_x), abs(z - before_z))
            if abs(d - before_depth) < 0.1 * d and resolution < gap < 6.0 * resolution:
                pieces = int(gap / resolution) + 1
                for i in range(1, pieces):
                    t = i / pieces
                    row = int((z + t * (before_z - z) - origin_z) / resolution)
                    hits[row, int((x + t * (before_x - x) - origin_x) / resolution)] = 1
            before_x, before_z, before_depth = x, z, d
    return kinds, ranges, hits


@compiled
def _relabel_feet(kinds, depth, hits, pose, lens, lattice):  # type: ignore[no-untyped-def]
    """Relabel the lowest part of obstacles, which is as low as floor, as obstacle.

    Otherwise the cells behind the foot of a wall would be seen free, up to where the line of sight meets the floor.
    """
    f, cx, cy = lens
    origin_x, origin_z, resolution = lattice
    for v in range(kinds.shape[0]):
        b = (v - cy) / f
        for u in range(kinds.shape[1]):
            if kinds[v, u] == _FLOOR:
                a, d = (u - cx) / f, depth[v, u]
                x = (pose[0, 0] * a + pose[0, 1] * b + pose[0, 2]) * d + pose[0, 3]
                z = (pose[2, 0] * a + pose[2, 1] * b + pose[2, 2]) * d + pose[2, 3]
                if hits[int((z - origin_z) / resolution), int((x - origin_x) / resolution)]:
                    kinds[v, u] = _OBSTACLE


@compiled
def _gather(kinds, ranges, hits, pose, lens, floor, max_range, lattice, relative, log_odds, cells, views, seen):  # type: ignore[no-untyped-def]
    """Update the log-odds of every cell within range of the camera by one frame."""
    f, cx, cy = lens
    origin_x, origin_z, resolution = lattice
    height, width = kinds.shape
    reach = int(max_range / resolution) + 1
    camera_row = int((pose[2, 3] - origin_z) / resolution)
    camera_column = int((pose[0, 3] - origin_x) / resolution)
    dy = floor - pose[1, 3]
    for row in range(max(0, camera_row - reach), min(cells.shape[0], camera_row + reach + 1)):
        dz = origin_z + (row + 0.5) * resolution - pose[2, 3]
        for column in range(max(0, camera_column - reach), min(cells.shape[1], camera_column + reach + 1)):
            if log_odds[row, column] > MOST:
                continue
            evidence = 0.0
            dx = origin_x + (column + 0.5) * resolution - pose[0, 3]
            if hits[row, column]:
                evidence = HIT * resolution / (resolution + relative * math.sqrt(dx * dx + dz * dz))
            else:
                depth = pose[0, 2] * dx + pose[1, 2] * dy + pose[2, 2] * dz
                distance = math.sqrt(dx * dx + dz * dz)
                if depth <= 0.0 or distance > max_range:
                    continue
                right = pose[0, 0] * dx + pose[1, 0] * dy + pose[2, 0] * dz
                down = pose[0, 1] * dx + pose[1, 1] * dy + pose[2, 1] * dz
                u, v = math.floor(f * right / depth + cx + 0.5), math.floor(f * down / depth + cy + 0.5)
                if u < 0 or u >= width or v < 0:
                    continue
                if v < height:
                    kind = kinds[v, u]
                    behind = kind in (_OBSTACLE, _BEYOND) and ranges[v, u] > distance
                    if kind == _FLOOR or behind:
                        evidence = SEEN_FREE
                elif cells[row, column] == UNKNOWN and ranges[height - 1, u] > distance:
                    evidence = PASSED_OVER
            if evidence != 0.0:
                value = min(MOST, max(LEAST, log_odds[row, column] + evidence))
                log_odds[row, column] = value
                cells[row, column] = OCCUPIED if value > 0.0 else FREE
                views[row, column] += 1
                seen[row, column] = True
