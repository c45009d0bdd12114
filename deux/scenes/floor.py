"""Detection of the floors of a mesh: one for each storey of a building."""

import math
from dataclasses import dataclass

import numpy as np

from deux.contracts import Floor, SceneMesh
from deux.errors import DeuxError
from deux.scenes.cover import CEILING, inside_building
from deux.scenes.ray_caster import RayCaster

COLUMNS = 20_000  # number of vertical rays through a scene
SPACING = 1.0  # greatest distance in metres between two rays
LEVEL = 0.7  # least |cosine| between a level surface's normal and the vertical: scanned floors are rough
OUTWARD = 0.95  # least fraction of the surfaces seen from above that face up if the faces of solids point outwards
THICKNESS = 0.05  # metres; half the height over which the surfaces of one floor spread
BREADTH = 0.3  # metres; least extent of a floor to one side, along x and along z, which excludes the inside of walls
HEADROOM = 1.0  # metres of empty space above a surface that can be a floor
DOMINANT = 0.3  # least area of a floor, as a fraction of the largest level surface
LEAST_AREA = 1.0  # square metres
STOREY = 1.2  # metres; least distance between two floors: half a storey, as in split-level houses
SLOPED = 0.5  # least area at each height of a sloping floor, as a fraction of the area at its lower end
RISE = 2.4  # metres; greatest rise of one sloping floor: its ends are nearer to its middle than to the ceiling
ALIKE = 0.8  # the main floor is the lowest of those with at least this fraction of the largest one's area
GROUND = 4.0  # if a scene is this many times as large as its building, only the building is sampled again


def find_floors(mesh: SceneMesh, caster: RayCaster | None = None) -> tuple[Floor, ...]:
    """Find the floors of a scene: one for each storey of a building, but not roofs and the ground around it.

    The lowest point of the mesh is not reliable: scans have stray triangles, and buildings have stairs below their
    floors. Instead all surfaces along vertical rays, evenly spaced over the scene, are found. Level surfaces with
    `HEADROOM` above them are candidates; in a building, only those under a ceiling. A scene without a building
    (`deux.scenes.cover`) has no such restriction. The orientation of triangles, which is not reliable in files, is used
    only if nearly all surfaces seen from above face up: then the undersides of solid ground are excluded.

    A floor is a height with at least `DOMINANT` of the area of the largest level, at least `STOREY` above the next
    lower floor; of levels nearer to each other, such as split levels of a room, the lower one is the floor. A slope
    that rises by at most `RISE` is one floor at its middle height.

    Args:
        mesh: the scene.
        caster: a ray caster of `mesh` to reuse.

    Returns:
        The main floor, which is the largest, then the others from the lowest to the highest.

    Raises:
        DeuxError: no level surface is large enough to stand on.
    """
    surfaces = _level_surfaces(caster or RayCaster(mesh), _bounds(mesh))
    heights = np.sort(surfaces.height[surfaces.covered] if surfaces.building is not None else surfaces.height)
    largest = float(_counts(heights).max(initial=0) * surfaces.area_each)
    if largest < LEAST_AREA:
        raise DeuxError("there is no floor to stand on: no level surface of 1 m2 has 1 m of empty space above it.")
    levels = _levels(heights, surfaces.area_each, max(LEAST_AREA, DOMINANT * largest))
    floors = [floor for floor in levels if floor.area >= DOMINANT * max(other.area for other in levels)]
    main = next(floor for floor in floors if floor.area >= ALIKE * max(other.area for other in floors))
    return (main, *(floor for floor in floors if floor is not main))


def building_bounds(mesh: SceneMesh, caster: RayCaster | None = None) -> tuple[float, float, float, float] | None:
    """The bounding rectangle (x_min, z_min, x_max, z_max in metres) of a scene's building; None without a building."""
    return _level_surfaces(caster or RayCaster(mesh), _bounds(mesh)).building


@dataclass(frozen=True)
class _LevelSurfaces:
    """Points on vertical rays through a scene that could belong to a floor.

    Args:
        height: N, world y in metres.
        covered: N bool, whether there is a ceiling above.
        area_each: the area in m2 that each point represents.
        building: x_min, z_min, x_max and z_max of the building, None if there is none.
    """

    height: np.ndarray
    covered: np.ndarray
    area_each: float
    building: tuple[float, float, float, float] | None


def _bounds(mesh: SceneMesh) -> tuple[float, float, float, float]:
    low, high = mesh.bounds.astype(float)[:, [0, 2]].tolist()
    return (low[0], low[1], high[0], high[1])


def _level_surfaces(caster: RayCaster, bounds: tuple[float, float, float, float]) -> _LevelSurfaces:
    """Sample the level surfaces of a scene within bounds, and find its building."""
    size = np.maximum(np.array(bounds[2:]) - bounds[:2], 1e-3)
    spacing = min(SPACING, math.sqrt(float(size.prod()) / COLUMNS))
    columns, rows = np.maximum(np.ceil(size / spacing - 1e-3), 1).astype(int)
    row, column = np.divmod(np.arange(rows * columns), columns)
    # Random positions within the cells: rays exactly through edges between triangles may miss both.
    places = np.stack([column, row], axis=-1) + np.random.default_rng(0).random((rows * columns, 2))
    height, face = caster.surfaces_below(np.array(bounds[:2]) + spacing * places)
    slope = _slope(caster.mesh)[face]
    level = (np.abs(slope) > LEVEL) & (face >= 0)
    headroom, topmost = _above(height, level)
    standing = level & topmost & (headroom > HEADROOM)
    if len(height) and (slope[0][face[0] >= 0] > 0.0).mean() > OUTWARD:
        # The number of solids around a point is the number of surfaces above it that face up, minus those facing down.
        solids = np.cumsum(np.sign(slope) * (face >= 0), axis=0) - np.sign(slope)
        # If no candidate is on top of solids, these are not solids but rooms whose faces point outwards.
        if (standing & (solids <= 0) & (height < caster.mesh.bounds[1, 1] - HEADROOM)).any():
            standing &= (slope > 0.0) | (solids <= 0)
    standing &= _is_broad(np.where(standing, height, np.nan).reshape(-1, rows, columns), spacing).reshape(face.shape)
    covered = standing & (headroom < CEILING)
    inside = inside_building(
        standing.any(axis=0).reshape(rows, columns), covered.any(axis=0).reshape(rows, columns), spacing
    )
    building = None
    if inside is not None:
        covered &= inside.ravel()
        where = np.argwhere(inside)
        z, x = (np.array([where.min(axis=0) - 1, where.max(axis=0) + 2]) * spacing).T
        building = (
            float(max(bounds[0], bounds[0] + x[0])),
            float(max(bounds[1], bounds[1] + z[0])),
            float(min(bounds[2], bounds[0] + x[1])),
            float(min(bounds[3], bounds[1] + z[1])),
        )
        if size.prod() > GROUND * (building[2] - building[0]) * (building[3] - building[1]):
            return _level_surfaces(caster, building)
    return _LevelSurfaces(height[standing], covered[standing], spacing**2, building)


def _above(height: np.ndarray, level: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The headroom above surfaces on vertical rays.

    Surfaces within 2 x `THICKNESS` above a surface are ignored: its roughness, a rug on it, the floor on a slab.

    Args:
        height: K x N world y from the highest surface of each ray down, NaN if it has fewer.
        level: K x N bool, whether the surface is level.

    Returns:
        K x N metres of empty space, infinite if there is nothing above; and K x N bool, whether no other level surface
        is within 2 x `THICKNESS` above.
    """
    room, topmost = np.full(height.shape, np.inf), np.ones(height.shape, bool)
    for number in range(1, len(height)):
        rise = height[:number] - height[number]
        near = rise <= 2 * THICKNESS + 1e-6
        room[number] = np.where((rise > 0.0) & ~near, rise, np.inf).min(axis=0)
        topmost[number] = ~(near & level[:number]).any(axis=0)
    return room, topmost


def _is_broad(height: np.ndarray, spacing: float) -> np.ndarray:
    """Which surfaces, K x rows x columns world y or NaN, continue at about the same height for `BREADTH`."""
    shift = max(1, round(BREADTH / spacing))
    broad = np.ones(height.shape, bool)
    for axis in (1, 2):
        continues = np.zeros(height.shape, bool)
        for step in (shift, -shift):
            beside = np.full(height.shape, np.nan)
            if shift < height.shape[axis]:
                index: list[slice] = [slice(None)] * 3
                index[axis] = slice(max(step, 0), min(step, 0) or None)
                source = list(index)
                source[axis] = slice(max(-step, 0), min(-step, 0) or None)
                beside[tuple(index)] = height[tuple(source)]
            for other in beside:
                continues |= np.abs(height - other) <= 2 * THICKNESS
        broad &= continues
    return broad


def _slope(mesh: SceneMesh) -> np.ndarray:
    """Cosine between each triangle's normal, as oriented by its corners, and the vertical; F, 0 if it has no area."""
    corners = mesh.triangles.astype(np.float64)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    cosine: np.ndarray = normals[:, 1] / np.maximum(np.linalg.norm(normals, axis=1), 1e-12)
    return cosine


def _levels(heights: np.ndarray, area_each: float, least_area: float) -> list[Floor]:
    """Find the levels with at least a given area, from the lowest to the highest, no two of them within `STOREY`.

    Args:
        heights: N sorted world y of level surfaces, metres.
        area_each: the area in m2 that each height represents.
        least_area: the least area of a level in m2.
    """
    levels: list[Floor] = []
    while heights.size:
        counts = _counts(heights)
        large = counts * area_each >= least_area
        if not large.any():
            break
        # The first height with a large area is at the lower edge of the floor's spread; the floor is at the peak.
        lowest = heights[np.argmax(large)]
        near = (heights >= lowest) & (heights <= lowest + 2 * THICKNESS)
        peak = np.flatnonzero(near)[np.argmax(counts[near])]
        first = np.searchsorted(heights, heights[peak] - THICKNESS)
        level = heights[first : first + counts[peak]]
        height, top = float(np.median(level)), _slope_top(heights, counts, peak)
        if top < height + STOREY:
            levels.append(Floor(height, float(counts[peak] * area_each)))
            heights = heights[heights >= height + STOREY]
        else:
            slope = heights[(heights >= lowest) & (heights <= top)]
            levels.append(Floor(float(lowest + top) / 2, float(len(slope) * area_each)))
            heights = heights[(heights > top) & (heights >= levels[-1].height + STOREY)]
    return levels


def _slope_top(heights: np.ndarray, counts: np.ndarray, peak: int) -> float:
    """The height, at most `RISE` above the peak, up to which level surfaces continue without gaps."""
    continues = (counts[peak + 1 :] >= SLOPED * counts[peak]) & (np.diff(heights[peak:]) <= 2 * THICKNESS)
    last = peak + int(np.argmin(np.append(continues, False)))
    return min(float(heights[last]), float(heights[peak]) + RISE)


def _counts(heights: np.ndarray) -> np.ndarray:
    """For each of N sorted heights, the number of heights within `THICKNESS` of it."""
    last = np.searchsorted(heights, heights + THICKNESS, side="right")
    return last - np.searchsorted(heights, heights - THICKNESS)
