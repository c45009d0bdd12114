"""Simulated sparse depth of different sensors: patterns of measured pixels, and measurement errors.

`deux.collection.sparse` samples the paper's corners; these patterns are for models that should work with any sensor.
"""

from typing import Literal, get_args

import numpy as np

from deux.collection.sparse import SparseSettings, sample_sparse

Pattern = Literal["corners", "uniform", "grid", "lines", "clusters"]
"""Where the points lie: at Harris corners, as in visual odometry; uniformly distributed; on a grid, as in a
time-of-flight sensor; on scan lines, as in a LiDAR; in clusters, as features on a few textured objects."""

PATTERNS: tuple[Pattern, ...] = get_args(Pattern)
"""All patterns."""

CORNER_CHOICE = 1.5
"""Candidate corners per drawn point: a tracker does not keep the same corners in every frame."""

POINTS_OF_A_CLUSTER = 12
"""Mean number of points in a cluster."""

CLUSTER_SPREAD = 0.06
"""Standard deviation of a cluster's points from its centre, as a fraction of the image's shorter side."""

LINE_RATIO = 3.0
"""Distance between scan lines, relative to the distance between points on a line."""

LARGEST_TILT = 0.1
"""Largest slope of scan lines: a robot's LiDAR is not exactly level."""

OUTLIER_FACTOR = 2.5
"""An outlier's depth is the true one times up to this factor, or divided by it."""


def draw_points(
    pattern: Pattern, image: np.ndarray, depth: np.ndarray, count: int, rng: np.random.Generator
) -> np.ndarray:
    """Keep the depth at about `count` pixels.

    Args:
        pattern: where the points lie.
        image: H x W x 3 uint8; used for corners only.
        depth: H x W float32 metres, 0 = none.
        count: number of points, 1 or more. Grids and lines have this number on average in images without missing depth;
            points at pixels without depth are dropped.
        rng: source of randomness.

    Returns:
        H x W float32 metres, 0 = none.

    Example:
        >>> depth, rng = np.full((40, 40), 2.0, np.float32), np.random.default_rng(0)
        >>> points = draw_points("uniform", np.zeros((40, 40, 3), np.uint8), depth, 16, rng)
        >>> int(np.count_nonzero(points)), points.max().item()
        (16, 2.0)
    """
    if pattern == "corners":
        chosen = _corners(image, depth, count, rng)
    elif pattern == "uniform":
        known = np.flatnonzero(depth)
        chosen = rng.choice(known, min(count, len(known)), replace=False)
    elif pattern == "grid":
        chosen = _grid(depth.shape, count, rng)
    elif pattern == "lines":
        chosen = _lines(depth.shape, count, rng)
    else:
        chosen = _clusters(depth, count, rng)
    sparse = np.zeros_like(depth)
    sparse.flat[chosen] = depth.flat[chosen]
    return sparse


def disturb(sparse_depth: np.ndarray, noise: float, outliers: float, rng: np.random.Generator) -> np.ndarray:
    """Add measurement errors: d (1 + e) with e from N(0, noise^2), and outliers by factors up to `OUTLIER_FACTOR`.

    Args:
        sparse_depth: H x W float32 metres, 0 = none.
        noise: standard deviation relative to the depth.
        outliers: fraction of the points, rounded, whose depth is multiplied by exp(u), u uniform in [-log f, log f].
        rng: source of randomness.

    Returns:
        H x W float32 metres, with points at the same pixels.
    """
    points = np.flatnonzero(sparse_depth)
    values = sparse_depth.flat[points].astype(np.float64)
    values *= np.maximum(1.0 + noise * rng.standard_normal(len(values)), 0.1)
    wrong = rng.permutation(len(values))[: round(outliers * len(values))]
    values[wrong] *= np.exp(rng.uniform(-1.0, 1.0, len(wrong)) * np.log(OUTLIER_FACTOR))
    disturbed = np.zeros_like(sparse_depth)
    disturbed.flat[points] = values
    return disturbed


def _corners(image: np.ndarray, depth: np.ndarray, count: int, rng: np.random.Generator) -> np.ndarray:
    candidates = SparseSettings(min(1.0, CORNER_CHOICE * count / depth.size))
    corners = np.flatnonzero(sample_sparse(image, depth, candidates))
    return rng.choice(corners, min(count, len(corners)), replace=False)


def _grid(shape: tuple[int, ...], count: int, rng: np.random.Generator) -> np.ndarray:
    """Rows and columns at equal distances, with a random offset."""
    height, width = shape
    step = max(1.0, np.sqrt(height * width / count))
    rows, columns = (np.arange(rng.uniform(0, min(step, side)), side, step).astype(int) for side in shape)
    return (rows[:, None] * width + columns).ravel()


def _lines(shape: tuple[int, ...], count: int, rng: np.random.Generator) -> np.ndarray:
    """Nearly horizontal lines at equal distances, with points at equal distances on each, with random offsets."""
    height, width = shape
    step = max(1.0, np.sqrt(height * width / count / LINE_RATIO))
    gap = min(max(1.0, height * width / count / step), height)
    slope = rng.uniform(-LARGEST_TILT, LARGEST_TILT)
    drop = abs(slope) * width
    starts = np.arange(rng.uniform(-drop - gap, -drop), height + drop, gap)
    columns = np.arange(width)[None] if step == 1.0 else _phased(len(starts), width, step, rng)
    rows = np.floor(starts[:, None] + slope * columns).astype(int)
    columns = np.broadcast_to(columns.astype(int), rows.shape)
    inside = (rows >= 0) & (rows < height) & (columns >= 0) & (columns < width)
    return np.unique(rows[inside] * width + columns[inside])


def _phased(lines: int, width: int, step: float, rng: np.random.Generator) -> np.ndarray:
    """Columns of the points on each line, L x P; some may lie beyond the image."""
    return rng.uniform(0, step, (lines, 1)) + np.arange(0, width, step)[None]


def _clusters(depth: np.ndarray, count: int, rng: np.random.Generator) -> np.ndarray:
    """Normally distributed points around random pixels with depth; fewer than `count` if there is no room."""
    height, width = depth.shape
    known = np.flatnonzero(depth)
    if not len(known):
        return known
    centres = rng.choice(known, max(1, round(count / POINTS_OF_A_CLUSTER)))
    spread = max(1.0, CLUSTER_SPREAD * min(height, width))
    drawn = rng.choice(centres, 4 * count)
    rows = np.rint(drawn // width + spread * rng.standard_normal(len(drawn))).astype(int)
    columns = np.rint(drawn % width + spread * rng.standard_normal(len(drawn))).astype(int)
    inside = (rows >= 0) & (rows < height) & (columns >= 0) & (columns < width)
    pixels = rows[inside] * width + columns[inside]
    pixels = pixels[depth.flat[pixels] > 0]
    _, first = np.unique(pixels, return_index=True)
    return pixels[np.sort(first)][:count]
