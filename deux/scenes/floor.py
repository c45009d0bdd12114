"""The floors that a robot can drive on, found from the mesh alone: one for each storey of a building."""

import math
from dataclasses import dataclass

import numpy as np

from deux.contracts import Floor, SceneMesh
from deux.errors import DeuxError
from deux.scenes.cover import CEILING, inside_building
from deux.scenes.ray_caster import RayCaster

COLUMNS = 20_000  # verticals along which a scene is looked at
SPACING = 1.0  # greatest distance in metres between two of them
LEVEL = 0.7  # least |cosine| between a level surface's normal and the vertical: scanned floors are rough
OUTWARD = 0.95  # fraction of the surfaces seen from above that face up where solids have their faces outside
THICKNESS = 0.05  # half the height in metres over which one floor's surfaces spread
BREADTH = 0.3  # metres that a floor goes on to one side at least, along x and along z: it is not the inside of a wall
HEADROOM = 1.0  # metres of empty space above anything that can be a floor
DOMINANT = 0.3  # a floor's least area, as a fraction of the largest level surface
LEAST_AREA = 1.0  # square metres
STOREY = 1.2  # least distance in metres between two floors: half a storey, as in split-level houses
SLOPED = 0.5  # least area at each height between two levels, as a fraction of the lower one's, if they are one slope
RISE = 2.4  # greatest rise of one sloping floor in metres: its ends are nearer to its middle than the ceiling over them
ALIKE = 0.8  # floors of at least this fraction of the largest one's area are as large: the lowest is the main one
GROUND = 4.0  # a scene that is this many times as large as its building is looked at once more, without its ground


def find_floors(mesh: SceneMesh, caster: RayCaster | None = None) -> tuple[Floor, ...]:
    """Find the floors of a scene: one for each storey of a building, none for roofs and the ground around it.

    The mesh's lowest point will not do: scans have stray triangles and buildings have stairs below their floors. All
    surfaces on verticals that are spread evenly over the scene are looked at. Those that are level and have `HEADROOM`
    above them can be floors; in a building, only those under a ceiling. Where hardly anything is under a ceiling the
    scene has no building in it (`deux.scenes.cover`) and all of them can.
    Files disagree about the direction in which triangles face. Only where nearly all that is seen from above faces up
    is it used, to leave out the undersides of solid ground, which face down and have the inside of the ground above.

    A floor is a height that has at least `DOMINANT` of the area of the largest such level, `STOREY` at least from the
    floor below; between two floors that are nearer to each other, as split levels of a room are, the lower one counts.
    A floor that rises evenly by `RISE` at most is one floor at its middle height.

    Args:
        mesh: the scene.
        caster: rays against `mesh`, where there is one already.

    Returns:
        The main floor, which is the largest, then the others from the lowest to the highest.

    Raises:
        DeuxError: nothing in the scene is level and large enough to stand on.
    """
    seen = _look(caster or RayCaster(mesh), _bounds(mesh))
    heights = np.sort(seen.height[seen.covered] if seen.building is not None else seen.height)
    largest = float(_counts(heights).max(initial=0) * seen.area_each)
    if largest < LEAST_AREA:
        raise DeuxError("there is no floor to stand on: no level surface of 1 m2 has 1 m of empty space above it.")
    levels = _levels(heights, seen.area_each, max(LEAST_AREA, DOMINANT * largest))
    floors = [floor for floor in levels if floor.area >= DOMINANT * max(other.area for other in levels)]
    main = next(floor for floor in floors if floor.area >= ALIKE * max(other.area for other in floors))
    return (main, *(floor for floor in floors if floor is not main))


def building_bounds(mesh: SceneMesh, caster: RayCaster | None = None) -> tuple[float, float, float, float] | None:
    """The rectangle (x_min, z_min, x_max, z_max in world metres) around a scene's building; None if there is none."""
    return _look(caster or RayCaster(mesh), _bounds(mesh)).building


@dataclass(frozen=True)
class _LevelSurfaces:
    """The places on verticals through a scene where a floor could be.

    Args:
        height: N, world y in metres.
        covered: N bool, whether there is a ceiling above.
        area_each: the area in m2 that each stands for.
        building: x_min, z_min, x_max and z_max of the building, None if there is none.
    """

    height: np.ndarray
    covered: np.ndarray
    area_each: float
    building: tuple[float, float, float, float] | None


def _bounds(mesh: SceneMesh) -> tuple[float, float, float, float]:
    low, high = mesh.bounds.astype(float)[:, [0, 2]].tolist()
    return (low[0], low[1], high[0], high[1])


def _look(caster: RayCaster, bounds: tuple[float, float, float, float]) -> _LevelSurfaces:
    """Find the level surfaces of a scene within bounds, and where its building is."""
    size = np.maximum(np.array(bounds[2:]) - bounds[:2], 1e-3)
    spacing = min(SPACING, math.sqrt(float(size.prod()) / COLUMNS))
    columns, rows = np.maximum(np.ceil(size / spacing - 1e-3), 1).astype(int)
    row, column = np.divmod(np.arange(rows * columns), columns)
    # At random in their cells: vertical through the edges between triangles, a ray may slip through.
    places = np.stack([column, row], axis=-1) + np.random.default_rng(0).random((rows * columns, 2))
    height, face = caster.surfaces_below(np.array(bounds[:2]) + spacing * places)
    slope = _slope(caster.mesh)[face]
    level = (np.abs(slope) > LEVEL) & (face >= 0)
    headroom, topmost = _above(height, level)
    standing = level & topmost & (headroom > HEADROOM)
    if len(height) and (slope[0][face[0] >= 0] > 0.0).mean() > OUTWARD:
        # A point is in as many solids as more surfaces above it face up than down.
        solids = np.cumsum(np.sign(slope) * (face >= 0), axis=0) - np.sign(slope)
        # Where nothing stands on what is solid, it is a room whose faces look outward.
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
            return _look(caster, building)
    return _LevelSurfaces(height[standing], covered[standing], spacing**2, building)


def _above(height: np.ndarray, level: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """What is above surfaces on verticals.

    What is within 2 x `THICKNESS` above a surface is its own roughness, a rug on it, or the floor on a ground slab.

    Args:
        height: K x N world y, from the highest surface down, NaN where there are no more.
        level: K x N bool, whether the surface is level.

    Returns:
        K x N metres of empty space, infinite where there is nothing above; and K x N bool, whether no other level
        surface is just above.
    """
    room, topmost = np.full(height.shape, np.inf), np.ones(height.shape, bool)
    for number in range(1, len(height)):
        rise = height[:number] - height[number]
        near = rise <= 2 * THICKNESS + 1e-6
        room[number] = np.where((rise > 0.0) & ~near, rise, np.inf).min(axis=0)
        topmost[number] = ~(near & level[:number]).any(axis=0)
    return room, topmost


def _is_broad(height: np.ndarray, spacing: float) -> np.ndarray:
    """Which surfaces, K x rows x columns world y or NaN, go on at about the same height for `BREADTH`."""
    shift = max(1, round(BREADTH / spacing))
    broad = np.ones(height.shape, bool)
    for axis in (1, 2):
        goes_on = np.zeros(height.shape, bool)
        for step in (shift, -shift):
            beside = np.full(height.shape, np.nan)
            if shift < height.shape[axis]:
                kept, taken = slice(max(step, 0), min(step, 0) or None), slice(max(-step, 0), min(-step, 0) or None)
                index: list[slice] = [slice(None)] * 3
                index[axis] = kept
                source = list(index)
                source[axis] = taken
                beside[tuple(index)] = height[tuple(source)]
            for other in beside:
                goes_on |= np.abs(height - other) <= 2 * THICKNESS
        broad &= goes_on
    return broad


def _slope(mesh: SceneMesh) -> np.ndarray:
    """Cosine between each triangle's normal, by the order of its corners, and the vertical; F, 0 if it has no area."""
    corners = mesh.triangles.astype(np.float64)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    cosine: np.ndarray = normals[:, 1] / np.maximum(np.linalg.norm(normals, axis=1), 1e-12)
    return cosine


def _levels(heights: np.ndarray, area_each: float, least_area: float) -> list[Floor]:
    """All levels of at least an area, from the lowest to the highest, no two of them within `STOREY`.

    Args:
        heights: N, sorted: world y of level surfaces, metres.
        area_each: the area in m2 that each of them stands for.
        least_area: in m2.
    """
    levels: list[Floor] = []
    while heights.size:
        counts = _counts(heights)
        large = counts * area_each >= least_area
        if not large.any():
            break
        # The first large one is at the floor's lower fringe; the floor is where its surfaces are densest.
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
    """The height, `RISE` higher at most, up to which level surface goes on evenly from one of the sorted heights."""
    goes_on = (counts[peak + 1 :] >= SLOPED * counts[peak]) & (np.diff(heights[peak:]) <= 2 * THICKNESS)
    last = peak + int(np.argmin(np.append(goes_on, False)))
    return min(float(heights[last]), float(heights[peak]) + RISE)


def _counts(heights: np.ndarray) -> np.ndarray:
    """For each of the sorted heights, how many of them are within `THICKNESS` of it."""
    last = np.searchsorted(heights, heights + THICKNESS, side="right")
    return last - np.searchsorted(heights, heights - THICKNESS)
