"""The true free floor of a scene: where the centre of a robot can be."""

from __future__ import annotations

from typing import TYPE_CHECKING

import cv2
import numpy as np
from scipy import ndimage

from deux.contracts import SceneMesh
from deux.errors import DeuxError
from deux.geometry.grid import FreeSpace, GridFrame
from deux.scenes.ray_caster import RayCaster

if TYPE_CHECKING:
    from deux.contracts import Robot

RAYS = 1_000_000  # at once, as each takes 40 bytes
FINENESS = 3  # samples along a cell's edge; odd, so that the middle one is the cell's centre


def free_space(
    mesh: SceneMesh,
    floor_height: float,
    robot: Robot,
    resolution: float = 0.05,
    caster: RayCaster | None = None,
) -> FreeSpace:
    """Find the largest connected part of the floor on which the robot fits.

    The robot is blocked where a ray down from its height meets no surface within `robot.max_climb` of the floor, and
    where any triangle passes through the height between there and the robot's top: rays alone miss upright sheets.
    What is blocked grows by the robot's radius. Floor beyond `robot.max_climb` (up a ramp or stairs) does not count.

    Args:
        mesh: the scene.
        floor_height: world y of the floor, metres.
        robot: its radius, height and greatest climb.
        resolution: edge of a cell in metres.
        caster: rays against `mesh`, where there is one already.

    Raises:
        DeuxError: the robot fits nowhere.
    """
    low, high = mesh.bounds[0, [0, 2]], mesh.bounds[1, [0, 2]]
    # A thousandth of a cell, left over by rounding, makes no new cell.
    columns, rows = np.maximum(np.ceil((high - low) / resolution - 1e-3), 1).astype(int)
    frame = GridFrame(float(low[0]), float(low[1]), int(rows), int(columns), resolution)
    fine = GridFrame(
        frame.origin_x, frame.origin_z, frame.rows * FINENESS, frame.columns * FINENESS, resolution / FINENESS
    )

    blocked = _blocked_from_above(caster or RayCaster(mesh), fine, floor_height, robot)
    _mark_upright(blocked, fine, mesh.triangles, floor_height + robot.max_climb, floor_height + robot.height)
    # Beyond the scene's bounds there is no floor either.
    open_cells = np.pad(~blocked, 1).view(np.uint8)
    cells = cv2.distanceTransform(open_cells, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)  # exact, at 4 bytes a cell
    centres = cells[1:-1, 1:-1][FINENESS // 2 :: FINENESS, FINENESS // 2 :: FINENESS]
    clearance = (centres.astype(np.float64) * fine.resolution).astype(np.float32)

    regions, count = ndimage.label(clearance > robot.radius)
    if count == 0:
        raise DeuxError(
            f"there is no floor to stand on: at height {floor_height:.2f} m no place is free for a robot of radius "
            f"{robot.radius} m and height {robot.height} m."
        )
    sizes = np.bincount(regions.ravel())
    sizes[0] = 0
    return FreeSpace(frame, regions == sizes.argmax(), clearance, floor_height)


def _blocked_from_above(caster: RayCaster, grid: GridFrame, floor_height: float, robot: Robot) -> np.ndarray:
    """Rows x columns bool: no floor, or something on it, below a ray from the robot's height at the cell's centre."""
    x = grid.origin_x + (np.arange(grid.columns) + 0.5) * grid.resolution
    z = grid.origin_z + (np.arange(grid.rows) + 0.5) * grid.resolution
    blocked = np.empty(grid.shape, bool)
    rows = max(1, RAYS // grid.columns)
    for first in range(0, grid.rows, rows):
        block = blocked[first : first + rows]
        origins = np.empty((*block.shape, 3), np.float32)
        origins[..., 0], origins[..., 1] = x, floor_height + robot.height
        origins[..., 2] = z[first : first + rows, None]
        down = np.broadcast_to(np.array([0.0, -1.0, 0.0], np.float32), origins.shape)
        fall = caster.cast(origins.reshape(-1, 3), down.reshape(-1, 3)).distance.reshape(block.shape)
        block[...] = np.abs(fall - robot.height) > robot.max_climb
    return blocked


def _mark_upright(blocked: np.ndarray, grid: GridFrame, triangles: np.ndarray, low: float, high: float) -> None:
    """Set the cells under the outlines of all triangles' parts between the heights `low` and `high`.

    The outline is enough: inside it, a part that is not upright is met by the rays from above.

    Args:
        blocked: rows x columns bool, changed in place.
        grid: where `blocked` lies.
        triangles: F x 3 x 3, metres.
        low: lower height in metres.
        high: upper height in metres.
    """
    heights = triangles[..., 1]
    corners = triangles[(heights.max(axis=1) > low) & (heights.min(axis=1) < high)].astype(np.float64)
    starts, ends = corners, np.roll(corners, -1, axis=1)
    rise = ends[..., 1] - starts[..., 1]
    with np.errstate(divide="ignore", invalid="ignore"):
        crossings = (np.array([low, high])[:, None, None] - starts[..., 1]) / rise
    segments = [_clipped(starts, ends, crossings, low, high)]
    for crossing in crossings:
        segments.append(_section(starts, ends, crossing))
    segment = np.concatenate(segments)[..., [0, 2]]
    length = np.linalg.norm(segment[:, 1] - segment[:, 0], axis=1)
    steps = np.ceil(length / (0.5 * grid.resolution)).astype(np.int64) + 1
    which = np.repeat(np.arange(len(segment)), steps)
    index = np.arange(len(which)) - np.repeat(np.cumsum(steps) - steps, steps)
    fraction = (index / np.maximum(steps - 1, 1)[which])[:, None]
    points = segment[which, 0] * (1.0 - fraction) + segment[which, 1] * fraction
    rows, columns = grid.cells(points[:, 0], points[:, 1])
    inside = grid.contains(rows, columns)
    blocked[rows[inside], columns[inside]] = True


def _clipped(starts: np.ndarray, ends: np.ndarray, crossings: np.ndarray, low: float, high: float) -> np.ndarray:
    """The parts of triangles' edges (F x 3 x 3 each) between two heights, S x 2 x 3.

    `crossings` (2 x F x 3) are the fractions of the edges at which they cross the two heights.
    """
    level = starts[..., 1] == ends[..., 1]
    within = (starts[..., 1] > low) & (starts[..., 1] < high)
    enter = np.where(level, np.where(within, 0.0, 1.0), np.clip(crossings.min(axis=0), 0.0, 1.0))
    leave = np.where(level, np.where(within, 1.0, 0.0), np.clip(crossings.max(axis=0), 0.0, 1.0))
    kept = leave > enter
    edge = (ends - starts)[kept]
    return np.stack([starts[kept] + edge * enter[kept][:, None], starts[kept] + edge * leave[kept][:, None]], axis=1)


def _section(starts: np.ndarray, ends: np.ndarray, crossing: np.ndarray) -> np.ndarray:
    """The segments, S x 2 x 3, in which triangles meet a level plane that their edges cross at `crossing` (F x 3)."""
    met = (crossing >= 0.0) & (crossing < 1.0)
    cut = met.sum(axis=1) == 2
    fraction = crossing[cut][met[cut]].reshape(-1, 2, 1)
    first, second = starts[cut][met[cut]].reshape(-1, 2, 3), ends[cut][met[cut]].reshape(-1, 2, 3)
    return first + fraction * (second - first)
