"""The floors that a robot can drive on, found from the mesh alone: one for each storey of a building."""

import numpy as np

from deux.contracts import Floor, SceneMesh
from deux.errors import DeuxError
from deux.scenes.ray_caster import RayCaster

SAMPLES = 20_000
LEVEL = 0.7  # least |cosine| between a level surface's normal and the vertical: scanned floors are rough
THICKNESS = 0.05  # half the height in metres over which one floor's samples spread
HEADROOM = 1.0  # metres of empty space above anything that can be a floor
CEILING = 8.0  # metres above a floor within which its ceiling is
DOMINANT = 0.3  # a floor's least area, as a fraction of the largest level surface
LEAST_AREA = 1.0  # square metres
STOREY = 2.0  # least distance in metres between two floors


def find_floors(mesh: SceneMesh, caster: RayCaster | None = None) -> tuple[Floor, ...]:
    """Find the floors of a scene; the main one is the lowest large level surface with room above it.

    The mesh's lowest point will not do: scans have stray triangles and buildings have stairs below their floors.
    Points are drawn on all level surfaces in proportion to their area, and those with `HEADROOM` above them are kept.
    The direction in which a triangle faces is not used, since files disagree about it.

    A further storey is at least `STOREY` above or below every other one and has, under a ceiling, at least `DOMINANT`
    of the area of the largest level surface under a ceiling. That leaves out roofs and the outside of the topmost
    ceiling. Where hardly anything is under a ceiling, the scene has none, and every level surface with room above it
    counts.

    Args:
        mesh: the scene.
        caster: rays against `mesh`, where there is one already.

    Returns:
        The main floor, then the others from the lowest to the highest.

    Raises:
        DeuxError: nothing in the scene is level and large enough to stand on.
    """
    points, area_each = _level_points(mesh)
    up = np.broadcast_to(np.array([0.0, 1.0, 0.0]), points.shape)
    # The ray starts above the surface's own roughness, and above rugs.
    above = (caster or RayCaster(mesh)).cast(points + 2 * THICKNESS * up, up).distance
    heights = np.sort(points[above > HEADROOM, 1])
    largest = _largest_area(heights, area_each)
    if largest < LEAST_AREA:
        raise DeuxError("there is no floor to stand on: no level surface of 1 m2 has 1 m of empty space above it.")
    main = _levels(heights, area_each, DOMINANT * largest)[0]
    covered = np.sort(points[(above > HEADROOM) & (above < CEILING), 1])
    # A roof is about as large as what it covers, so where that is little no roof is large enough to be a floor.
    if _largest_area(covered, area_each) >= DOMINANT * main.area:
        heights, largest = covered, _largest_area(covered, area_each)
    elsewhere = heights[np.abs(heights - main.height) >= STOREY]
    return (main, *_levels(elsewhere, area_each, max(LEAST_AREA, DOMINANT * largest)))


def _levels(heights: np.ndarray, area_each: float, least_area: float) -> list[Floor]:
    """All levels of at least an area, from the lowest to the highest, no two of them within `STOREY`.

    Args:
        heights: N, sorted: world y of the samples of level surfaces, metres.
        area_each: the area in m2 that each sample stands for.
        least_area: in m2.
    """
    levels: list[Floor] = []
    while heights.size:
        counts = _counts(heights)
        large = counts * area_each >= least_area
        if not large.any():
            break
        # The first large one is at the floor's lower fringe; the floor is where its samples are densest.
        lowest = heights[np.argmax(large)]
        near = (heights >= lowest) & (heights <= lowest + 2 * THICKNESS)
        peak = np.flatnonzero(near)[np.argmax(counts[near])]
        first = np.searchsorted(heights, heights[peak] - THICKNESS)
        level = heights[first : first + counts[peak]]
        levels.append(Floor(float(np.median(level)), float(counts[peak] * area_each)))
        heights = heights[heights >= levels[-1].height + STOREY]
    return levels


def _counts(heights: np.ndarray) -> np.ndarray:
    """For each of the sorted heights, how many of them are within `THICKNESS` of it."""
    last = np.searchsorted(heights, heights + THICKNESS, side="right")
    return last - np.searchsorted(heights, heights - THICKNESS)


def _largest_area(heights: np.ndarray, area_each: float) -> float:
    """The area in m2 of the largest level; arguments as of `_levels`."""
    return float(_counts(heights).max(initial=0) * area_each)


def _level_points(mesh: SceneMesh) -> tuple[np.ndarray, float]:
    """`SAMPLES` points spread evenly over the level triangles, and the horizontal area in m2 that each stands for."""
    corners = mesh.triangles.astype(np.float64)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    horizontal = np.abs(normals[:, 1])
    area = np.where(horizontal > LEVEL * np.linalg.norm(normals, axis=1), horizontal / 2, 0.0)
    total = float(area.sum())
    if total == 0.0:
        return np.zeros((0, 3)), 0.0
    rng = np.random.default_rng(0)
    steps = (np.arange(SAMPLES) + 0.5) * (total / SAMPLES)
    chosen = np.minimum(np.searchsorted(np.cumsum(area), steps), len(area) - 1)
    u, v = rng.random((2, SAMPLES, 1))
    outside = u + v > 1.0
    u, v = np.where(outside, 1.0 - u, u), np.where(outside, 1.0 - v, v)
    a, b, c = corners[chosen].transpose(1, 0, 2)
    return a + u * (b - a) + v * (c - a), total / SAMPLES
