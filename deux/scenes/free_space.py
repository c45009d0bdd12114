"""The free space of a floor: the positions that the centre of a robot can reach."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import cv2
import numpy as np
from scipy import ndimage

from deux.contracts import SceneMesh
from deux.errors import DeuxError
from deux.geometry.grid import FreeSpace, GridFrame
from deux.memory_budget import check_memory
from deux.scenes.cover import CEILING, inside_building
from deux.scenes.heightfield import walkable_surface
from deux.scenes.ray_caster import RayCaster

if TYPE_CHECKING:
    from deux.contracts import Robot

FINENESS = 3  # columns along a cell's edge; odd, so that the middle one is at the cell's centre
REACH = 2.0  # metres above and below a floor that belong to it if there is no other floor
SPLIT = 0.6  # metres; every part of a floor comes this near to its height: split levels do, tables do not
LEAST_LEVEL = 4.0  # square metres; smaller unreachable parts, such as table tops, are not reported
TOLERANCE = 1e-4  # metres; for rounding errors of distances on the grid
LARGEST = 40e6  # columns of the fine grid, 11,000 m2: about 2 GB
_COLUMN_BYTES = 50

Box = tuple[float, float, float, float]
"""x_min, z_min, x_max and z_max in world metres."""


@dataclass(frozen=True)
class UnreachedLevel:
    """A free level of a floor that is too high or too low for the robot to reach.

    Args:
        rise: its height above the robot's part of the floor, metres.
        area: its free area in square metres.
    """

    rise: float
    area: float


@dataclass(frozen=True)
class FloorSurvey:
    """The free space of one floor, and the parts of the floor that it does not include.

    Args:
        space: the free space.
        unreached: the large levels that the robot cannot climb to, the largest first.
        apart: square metres of the floor's height that cannot be reached, behind closed doors and narrow passages.
        outside: square metres that could be reached but are excluded because they are outside the building.
    """

    space: FreeSpace
    unreached: tuple[UnreachedLevel, ...]
    apart: float = 0.0
    outside: float = 0.0


def free_space(
    mesh: SceneMesh,
    floor_height: float,
    robot: Robot,
    resolution: float = 0.05,
    caster: RayCaster | None = None,
) -> FreeSpace:
    """Find the largest connected free part of the only floor of a scene; see `survey_floor`."""
    return survey_floor(mesh, floor_height, robot, resolution, caster).space


def survey_floor(
    mesh: SceneMesh,
    floor_height: float,
    robot: Robot,
    resolution: float = 0.05,
    caster: RayCaster | None = None,
    other_floors: Sequence[float] = (),
    bounds: Box | None = None,
    region: Box | None = None,
    start: tuple[float, float] | None = None,
) -> FloorSurvey:
    """Find a connected free part of a floor, by the method of Recast's navigation meshes.

    A floor includes the surfaces up to half the distance to the next floor above and below, or up to `REACH` if there
    is none, so that stairs, ramps and low steps are part of it. Where the robot can stand and step is determined by
    `walkable_surface`. Obstacles, including drops, are dilated by the robot's radius. The free space is limited to the
    inside of the building (`inside_building`), unless `region` is given or `start` is outside.

    All positions are relative to the mesh's origin; error messages give world positions.

    Args:
        mesh: the scene.
        floor_height: y of the floor, metres.
        robot: its radius, height and greatest climb.
        resolution: edge of a cell in metres.
        caster: a ray caster of `mesh` to reuse.
        other_floors: y of the scene's other floors, metres.
        bounds: the part of the scene to map; None for all of it.
        region: bounds of the robot's centre; None for no bounds.
        start: x and z of a point in the part to choose; None for the largest part.

    Raises:
        DeuxError: the robot fits nowhere, or not at `start`; or the scene is too large.
    """
    frame = _frame(mesh, resolution, region or bounds, robot.radius)
    heights, clearance, surfaces = _standing_room(mesh, frame, robot, floor_height, other_floors)
    # A radius of at least half a cell keeps the cells on both sides of a thin obstacle apart.
    free = clearance > max(robot.radius, resolution / 2) + TOLERANCE
    if region is not None:
        free &= _cells_in(frame, region)
    inside = free
    if region is None and free.any():
        inside = free & _inside(caster or RayCaster(mesh), frame, heights, free, start)
    parts = _parts_near(inside, heights, floor_height)
    if not parts.any():
        where = "" if region is None else f" of the region {_region_in_world(region, mesh)}"
        height = floor_height + mesh.origin[1]
        raise DeuxError(
            f"there is no floor to stand on: at height {height:.2f} m no place{where} is free for a robot of "
            f"radius {robot.radius} m and height {robot.height} m that climbs {robot.max_climb} m."
        )
    sizes = np.bincount(parts.ravel())
    sizes[0] = 0
    chosen = int(sizes.argmax()) if start is None else _part_at(frame, parts, start, mesh)
    taken = parts == chosen
    # Surfaces that cannot be reached, such as table tops, are obstacles with no clearance.
    clearance[~np.isin(surfaces, np.unique(surfaces[taken]))] = 0.0
    space = FreeSpace(frame, taken, clearance, floor_height, np.where(taken, heights, np.float32(np.nan)))
    unreached, apart = _left_out(parts, sizes * resolution**2, chosen, heights, robot.max_climb)
    outside = _connected(free, taken) & ~inside
    return FloorSurvey(space, unreached, apart, float(np.count_nonzero(outside) * resolution**2))


def _standing_room(
    mesh: SceneMesh, frame: GridFrame, robot: Robot, floor_height: float, other_floors: Sequence[float]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Compute height, clearance and connected surface of each cell's centre, rows x columns each.

    Returns:
        World y of the surface, NaN if there is none; metres to the nearest obstacle; number of the connected surface,
        0 if there is none.
    """
    below = max((y for y in other_floors if y < floor_height), default=floor_height - 2 * REACH)
    above = min((y for y in other_floors if y > floor_height), default=floor_height + 2 * REACH)
    resolution = frame.resolution / FINENESS
    fine = GridFrame(frame.origin_x, frame.origin_z, frame.rows * FINENESS, frame.columns * FINENESS, resolution)
    surface = walkable_surface(mesh, fine, robot, floor_height, (below + floor_height) / 2, (above + floor_height) / 2)
    # Outside of the grid there is no floor.
    passable = np.pad(~surface.blocked, 1).astype(np.uint8)
    distance = cv2.distanceTransform(passable, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)[1:-1, 1:-1]
    # On the fine grid, because an edge between a table top and the floor may be only one column wide.
    surfaces = cv2.connectedComponents(passable, connectivity=4)[1][1:-1, 1:-1]
    middle = slice(FINENESS // 2, None, FINENESS)
    clearance = distance[middle, middle] * np.float32(resolution)
    return surface.height[middle, middle], clearance, surfaces[middle, middle]


def _inside(
    caster: RayCaster, frame: GridFrame, heights: np.ndarray, free: np.ndarray, start: tuple[float, float] | None
) -> np.ndarray:
    """The free cells inside the building; all free cells if there is no building or the start is outside."""
    covered = _covered(caster, frame, heights, free)
    if start is not None and not covered[frame.cell(*start)]:
        return free
    inside = inside_building(free, covered, frame.resolution)
    return free if inside is None else inside


def _parts_near(free: np.ndarray, heights: np.ndarray, floor_height: float) -> np.ndarray:
    """Label the connected parts of the free cells from 1, rows x columns.

    Parts that are nowhere within `SPLIT` of the floor's height, such as a roof without stairs, are left out (0).
    """
    parts: np.ndarray = ndimage.label(free)[0]
    count = int(parts.max())
    nearest = ndimage.minimum(np.abs(heights - floor_height), parts, np.arange(count + 1))
    distant = np.asarray(nearest) > SPLIT
    distant[0] = False
    return np.where(distant[parts], 0, parts)


def _frame(mesh: SceneMesh, resolution: float, region: Box | None, radius: float) -> GridFrame:
    """The grid over the scene, or over a region of it with a margin for the robot's body."""
    bounds = mesh.bounds.astype(np.float64)
    low, high = bounds[0, [0, 2]], bounds[1, [0, 2]]
    if region is not None:
        margin = (np.ceil(radius / resolution) + 1) * resolution
        asked_low, asked_high = np.array(region[:2]) - margin, np.array(region[2:]) + margin
        if (asked_low >= high).any() or (asked_high <= low).any():
            raise DeuxError(
                f"the region {_region_in_world(region, mesh)} is not in the scene, which extends from "
                f"{_place_in_world(low, mesh)} to {_place_in_world(high, mesh)}."
            )
        low, high = np.where(asked_low > low, asked_low, low), np.minimum(asked_high, high)
    # The tolerance of a thousandth of a cell avoids a new cell because of rounding.
    columns, rows = np.maximum(np.ceil((high - low) / resolution - 1e-3), 1).astype(int)
    if int(columns) * int(rows) * FINENESS**2 > LARGEST:
        raise DeuxError(
            f"the floor of {high[0] - low[0]:.0f} x {high[1] - low[1]:.0f} m is too large for a map: limit it by "
            "scenes.region=[x_min, z_min, x_max, z_max]."
        )
    check_memory(
        _COLUMN_BYTES * int(columns) * int(rows) * FINENESS**2,
        f"the floor of {high[0] - low[0]:.0f} x {high[1] - low[1]:.0f} m",
        "limit it by scenes.region=[x_min, z_min, x_max, z_max]",
    )
    return GridFrame(float(low[0]), float(low[1]), int(rows), int(columns), resolution)


def _centres(frame: GridFrame) -> tuple[np.ndarray, np.ndarray]:
    """x of the columns' centres, and z of the rows' centres as rows x 1, metres."""
    x = frame.origin_x + (np.arange(frame.columns) + 0.5) * frame.resolution
    z = frame.origin_z + (np.arange(frame.rows) + 0.5) * frame.resolution
    return x, z[:, None]


def _cells_in(frame: GridFrame, region: Box) -> np.ndarray:
    """The cells whose centres lie in a region, rows x columns bool."""
    x, z = _centres(frame)
    inside: np.ndarray = (x >= region[0]) & (x <= region[2]) & (z >= region[1]) & (z <= region[3])
    return inside


def _covered(caster: RayCaster, frame: GridFrame, heights: np.ndarray, free: np.ndarray) -> np.ndarray:
    """The free cells, rows x columns bool, that have a ceiling above."""
    x, z = (np.broadcast_to(values, frame.shape)[free] for values in _centres(frame))
    up = np.broadcast_to(np.array([0.0, 1.0, 0.0]), (len(x), 3))
    covered = np.zeros(frame.shape, bool)
    covered[free] = caster.cast(np.stack([x, heights[free] + 0.5, z], axis=-1), up).distance < CEILING
    return covered


def _part_at(frame: GridFrame, parts: np.ndarray, start: tuple[float, float], mesh: SceneMesh) -> int:
    """The label of the connected part (rows x columns, 0 = none) that contains a point."""
    rows, columns = frame.cells(*start)
    if frame.contains(rows, columns) and parts[rows, columns] > 0:
        return int(parts[rows, columns])
    x, z = _centres(frame)
    distance = np.where(parts > 0, np.hypot(x - start[0], z - start[1]), np.inf)
    nearest = frame.centre(*divmod(int(distance.argmin()), frame.columns))
    raise DeuxError(
        f"the start {_place_in_world(start, mesh)} is not on free floor: the nearest free point is "
        f"{_place_in_world(nearest, mesh)}."
    )


def _place_in_world(place: Sequence[float] | np.ndarray, mesh: SceneMesh) -> str:
    """Format a point given relative to the mesh's origin by its world position, such as "x=1.00, z=-2.50"."""
    return f"x={place[0] + mesh.origin[0]:.2f}, z={place[1] + mesh.origin[2]:.2f}"


def _region_in_world(region: Box, mesh: SceneMesh) -> list[float]:
    x, _, z = mesh.origin
    return [round(side + shift, 3) for side, shift in zip(region, (x, z, x, z), strict=True)]


def _connected(cells: np.ndarray, some: np.ndarray) -> np.ndarray:
    """The connected parts of a mask that contain any of the given cells."""
    parts = ndimage.label(cells)[0]
    return np.isin(parts, np.unique(parts[some]))


def _left_out(
    parts: np.ndarray, areas: np.ndarray, chosen: int, heights: np.ndarray, climb: float
) -> tuple[tuple[UnreachedLevel, ...], float]:
    """Summarise the large parts other than the chosen one.

    Args:
        parts: rows x columns, labels of the connected parts.
        areas: area of each part in m2, by its label.
        chosen: label of the chosen part.
        heights: rows x columns, world y in metres.
        climb: the robot's greatest climb in metres.

    Returns:
        The levels that are farther away than a climb, and the area in m2 of the others.
    """
    ground = float(np.median(heights[parts == chosen]))
    large = [part for part in np.argsort(-areas, kind="stable") if areas[part] >= LEAST_LEVEL and part != chosen]
    levels = [UnreachedLevel(float(np.median(heights[parts == part])) - ground, float(areas[part])) for part in large]
    unreached = tuple(level for level in levels if abs(level.rise) > climb)
    return unreached, sum(level.area for level in levels if level not in unreached)
