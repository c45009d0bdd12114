"""The true free floor of a scene: where the centre of a robot can be."""

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
REACH = 2.0  # metres above and below a floor that belong to it where there is no other floor
SPLIT = 0.6  # metres from a floor's height within which any part of it must come: split levels do, tables do not
LEAST_LEVEL = 4.0  # square metres; smaller parts that the robot cannot reach, such as table tops, are not told of
TOLERANCE = 1e-4  # metres: distances on the grid are exact but for rounding
LARGEST = 40e6  # columns of the fine grid, 11,000 m2: about 2 GB
_COLUMN_BYTES = 50

Box = tuple[float, float, float, float]
"""x_min, z_min, x_max and z_max in world metres."""


@dataclass(frozen=True)
class UnreachedLevel:
    """A level of a floor that is free but too high or too low for the robot to get to.

    Args:
        rise: how much higher it lies than the part where the robot is, metres.
        area: free square metres.
    """

    rise: float
    area: float


@dataclass(frozen=True)
class FloorSurvey:
    """What is known of one floor.

    Args:
        space: the free floor.
        unreached: the large levels that are no part of it, the largest first.
        apart: square metres of its height that are no part of it either, behind closed doors and narrow passages.
        outside: square metres that the robot could get to, but that are left out since they are outside the building.
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
    """Find the largest connected part of a scene's only floor on which the robot fits; see `survey_floor`."""
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
    """Find a connected part of a floor on which the robot fits, as Recast's navigation meshes do.

    Surfaces belong to a floor up to half the way to the next floor above and below, or `REACH` where there is none, so
    stairs, ramps and low steps are free as far as that. The robot stands and steps as `walkable_surface` says. What it
    cannot step to, a drop too, grows by its radius. It stays inside the building, as `inside_building` says, unless
    `region` is given or `start` lies outside.

    All places count from the mesh's origin; sentences name them in the world.

    Args:
        mesh: the scene.
        floor_height: y of the floor, metres.
        robot: its radius, height and greatest climb.
        resolution: edge of a cell in metres.
        caster: rays against `mesh`, where there is one already.
        other_floors: y of the scene's other floors, metres.
        bounds: the part of the scene that is looked at; None for all of it.
        region: where the robot's centre stays; None for no bound.
        start: x and z of a point in the part that is taken; None for the largest one.

    Raises:
        DeuxError: the robot fits nowhere, or not at `start`; or the scene is too large.
    """
    frame = _frame(mesh, resolution, region or bounds, robot.radius)
    heights, clearance, surfaces = _standing_room(mesh, frame, robot, floor_height, other_floors)
    # With half a cell at least, an obstacle without thickness parts the cells on its two sides.
    free = clearance > max(robot.radius, resolution / 2) + TOLERANCE
    if region is not None:
        free &= _cells_in(frame, region)
    inside = free
    if region is None and free.any():
        inside = free & _where_it_lives(caster or RayCaster(mesh), frame, heights, free, start)
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
    # Surfaces that cannot be reached, such as table tops, are obstacles through and through.
    clearance[~np.isin(surfaces, np.unique(surfaces[taken]))] = 0.0
    space = FreeSpace(frame, taken, clearance, floor_height, np.where(taken, heights, np.float32(np.nan)))
    unreached, apart = _left_out(parts, sizes * resolution**2, chosen, heights, robot.max_climb)
    outside = _connected(free, taken) & ~inside
    return FloorSurvey(space, unreached, apart, float(np.count_nonzero(outside) * resolution**2))


def _standing_room(
    mesh: SceneMesh, frame: GridFrame, robot: Robot, floor_height: float, other_floors: Sequence[float]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """World y of the surface at each cell's centre, NaN where there is none, and metres to the nearest obstacle.

    Also the number of the connected surface that each cell's centre is on: rows x columns, 0 where it is on none.
    """
    below = max((y for y in other_floors if y < floor_height), default=floor_height - 2 * REACH)
    above = min((y for y in other_floors if y > floor_height), default=floor_height + 2 * REACH)
    resolution = frame.resolution / FINENESS
    fine = GridFrame(frame.origin_x, frame.origin_z, frame.rows * FINENESS, frame.columns * FINENESS, resolution)
    surface = walkable_surface(mesh, fine, robot, floor_height, (below + floor_height) / 2, (above + floor_height) / 2)
    # Beyond the grid there is no floor either.
    passable = np.pad(~surface.blocked, 1).astype(np.uint8)
    distance = cv2.distanceTransform(passable, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)[1:-1, 1:-1]
    # On the fine grid: an edge of one column, between a table top and the floor, may be at no cell's centre.
    surfaces = cv2.connectedComponents(passable, connectivity=4)[1][1:-1, 1:-1]
    middle = slice(FINENESS // 2, None, FINENESS)
    clearance = distance[middle, middle] * np.float32(resolution)
    return surface.height[middle, middle], clearance, surfaces[middle, middle]


def _where_it_lives(
    caster: RayCaster, frame: GridFrame, heights: np.ndarray, free: np.ndarray, start: tuple[float, float] | None
) -> np.ndarray:
    """The free cells that are inside the building; all of them if there is none or the start lies outside."""
    covered = _covered(caster, frame, heights, free)
    if start is not None and not covered[frame.cell(*start)]:
        return free
    inside = inside_building(free, covered, frame.resolution)
    return free if inside is None else inside


def _parts_near(free: np.ndarray, heights: np.ndarray, floor_height: float) -> np.ndarray:
    """The connected parts of the free cells, numbered from 1, rows x columns.

    What comes nowhere near the floor's height, such as a roof that no stairs lead to, is another floor or none.
    """
    parts: np.ndarray = ndimage.label(free)[0]
    count = int(parts.max())
    nearest = ndimage.minimum(np.abs(heights - floor_height), parts, np.arange(count + 1))
    distant = np.asarray(nearest) > SPLIT
    distant[0] = False
    return np.where(distant[parts], 0, parts)


def _frame(mesh: SceneMesh, resolution: float, region: Box | None, radius: float) -> GridFrame:
    """The grid over the scene, or over a region of it and as much around that as the robot's body reaches."""
    bounds = mesh.bounds.astype(np.float64)
    low, high = bounds[0, [0, 2]], bounds[1, [0, 2]]
    if region is not None:
        margin = (np.ceil(radius / resolution) + 1) * resolution
        asked_low, asked_high = np.array(region[:2]) - margin, np.array(region[2:]) + margin
        if (asked_low >= high).any() or (asked_high <= low).any():
            raise DeuxError(
                f"the region {_region_in_world(region, mesh)} is not in the scene: that reaches from "
                f"{_place_in_world(low, mesh)} to {_place_in_world(high, mesh)}."
            )
        low, high = np.where(asked_low > low, asked_low, low), np.minimum(asked_high, high)
    # A thousandth of a cell, left over by rounding, makes no new cell.
    columns, rows = np.maximum(np.ceil((high - low) / resolution - 1e-3), 1).astype(int)
    if int(columns) * int(rows) * FINENESS**2 > LARGEST:
        raise DeuxError(
            f"the floor of {high[0] - low[0]:.0f} x {high[1] - low[1]:.0f} m is too large for a map: bound it by "
            "scenes.region=[x_min, z_min, x_max, z_max]."
        )
    check_memory(
        _COLUMN_BYTES * int(columns) * int(rows) * FINENESS**2,
        f"the floor of {high[0] - low[0]:.0f} x {high[1] - low[1]:.0f} m",
        "bound it by scenes.region=[x_min, z_min, x_max, z_max]",
    )
    return GridFrame(float(low[0]), float(low[1]), int(rows), int(columns), resolution)


def _centres(frame: GridFrame) -> tuple[np.ndarray, np.ndarray]:
    """World x of the columns' centres, and world z of the rows' as rows x 1."""
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
    """The number of the connected part (rows x columns, 0 = none) in which a point lies."""
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
    """A text such as "x=1.00, z=-2.50" of a point that counts from the mesh's origin."""
    return f"x={place[0] + mesh.origin[0]:.2f}, z={place[1] + mesh.origin[2]:.2f}"


def _region_in_world(region: Box, mesh: SceneMesh) -> list[float]:
    x, _, z = mesh.origin
    return [round(side + shift, 3) for side, shift in zip(region, (x, z, x, z), strict=True)]


def _connected(cells: np.ndarray, some: np.ndarray) -> np.ndarray:
    """The parts of a mask that have cells in common with some of it."""
    parts = ndimage.label(cells)[0]
    return np.isin(parts, np.unique(parts[some]))


def _left_out(
    parts: np.ndarray, areas: np.ndarray, chosen: int, heights: np.ndarray, climb: float
) -> tuple[tuple[UnreachedLevel, ...], float]:
    """What is large of the parts, numbered in rows x columns and with their areas in m2, that are not the chosen one.

    Returns:
        The levels that are more than a climb away, and the area in m2 of the others, which something else parts.
    """
    ground = float(np.median(heights[parts == chosen]))
    large = [part for part in np.argsort(-areas, kind="stable") if areas[part] >= LEAST_LEVEL and part != chosen]
    levels = [UnreachedLevel(float(np.median(heights[parts == part])) - ground, float(areas[part])) for part in large]
    unreached = tuple(level for level in levels if abs(level.rise) > climb)
    return unreached, sum(level.area for level in levels if level not in unreached)
