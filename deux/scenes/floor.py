"""The height of the floor that a robot drives on, found from the mesh alone."""

import numpy as np

from deux.contracts import Floor, SceneMesh
from deux.errors import DeuxError
from deux.scenes.ray_caster import RayCaster

SAMPLES = 20_000
LEVEL = 0.7  # least |cosine| between a level surface's normal and the vertical: scanned floors are rough
THICKNESS = 0.05  # half the height in metres over which one floor's samples spread
HEADROOM = 1.0  # metres of empty space above anything that can be a floor
DOMINANT = 0.3  # a floor's least area, as a fraction of the largest level surface
LEAST_AREA = 1.0  # square metres


def find_floors(mesh: SceneMesh, caster: RayCaster | None = None) -> tuple[Floor, ...]:
    """The floor of a scene: the lowest large level surface with room above it.

    The mesh's lowest point will not do: scans have stray triangles and buildings have stairs below their floors.
    Points are drawn on all level surfaces in proportion to their area; those with `HEADROOM` above them vote. The
    direction in which a triangle faces is not used, since files disagree about it.

    Args:
        mesh: the scene.
        caster: rays against `mesh`, where there is one already.

    Raises:
        DeuxError: nothing in the scene is level and large enough to stand on.
    """
    points, area_each = _level_points(mesh)
    up = np.broadcast_to(np.array([0.0, 1.0, 0.0]), points.shape)
    # The ray starts above the surface's own roughness, and above rugs.
    above = (caster or RayCaster(mesh)).cast(points + 2 * THICKNESS * up, up).distance
    heights = np.sort(points[above > HEADROOM, 1])
    first = np.searchsorted(heights, heights - THICKNESS)
    last = np.searchsorted(heights, heights + THICKNESS, side="right")
    areas = (last - first) * area_each
    if not areas.size or areas.max() < LEAST_AREA:
        raise DeuxError("there is no floor to stand on: no level surface of 1 m2 has 1 m of empty space above it.")
    lowest = heights[np.argmax(areas >= DOMINANT * areas.max())]
    # `lowest` is at the floor's lower fringe; the floor is where its samples are densest.
    near = (heights >= lowest) & (heights <= lowest + 2 * THICKNESS)
    peak = np.flatnonzero(near)[np.argmax(areas[near])]
    return (Floor(float(np.median(heights[first[peak] : last[peak]])), float(areas[peak])),)


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
