"""Sparse depth as other sensors have it: which pixels of a depth map are measured, and how wrongly.

`deux.collection.sparse` has the corners of the paper; these patterns are for models that are to work with any sensor.
"""

from typing import Literal, get_args

import numpy as np

from deux.collection.sparse import SparseSettings, sample_sparse

Pattern = Literal["corners", "uniform", "grid", "lines", "clusters"]
"""Where the points lie: at Harris corners, as visual odometry has them; anywhere; on a grid, as a time-of-flight sensor
has them; on scan lines, as a LiDAR has them; in clusters, as features on a few textured objects."""

PATTERNS: tuple[Pattern, ...] = get_args(Pattern)
"""All patterns."""

CORNER_CHOICE = 1.5
"""Corners among which the points are drawn, for each point: a tracker does not keep the same ones in every frame."""

POINTS_OF_A_CLUSTER = 12
"""Mean number of points in a cluster."""

CLUSTER_SPREAD = 0.06
"""Standard deviation of a cluster's points from its centre, as a fraction of the image's shorter side."""

LINE_RATIO = 3.0
"""Distance between scan lines, in distances between the points on a line."""

LARGEST_TILT = 0.1
"""Slope of scan lines: a robot's LiDAR is not quite level."""

OUTLIER_FACTOR = 2.5
"""An outlier's depth is the true one times up to this factor, or divided by it."""


def draw_points(
    pattern: Pattern, image: np.ndarray, depth: np.ndarray, count: int, rng: np.random.Generator
) -> np.ndarray:
    """Keep the depth at about `count` pixels.

    Args:
        pattern: where they lie.
        image: H x W x 3 uint8; only corners look at it.
        depth: H x W float32 metres, 0 = none; no point lies there.
        count: number of points, 1 or more. Grids and lines hit it on average over images without holes; fewer come out
            where pixels without depth are hit, or where there are fewer pixels with depth.
        rng: of all that is drawn.

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
    """Measure wrongly: d (1 + e) with e from N(0, noise^2), and some points by a factor of up to `OUTLIER_FACTOR`.

    Args:
        sparse_depth: H x W float32 metres, 0 = none.
        noise: standard deviation relative to the depth.
        outliers: fraction of the points, rounded, whose depth is multiplied by exp(u), u uniform in [-log f, log f].
        rng: of all that is drawn.

    Returns:
        H x W float32 metres; the points are where they were.
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
    """Rows and columns at equal distances, the first at random."""
    height, width = shape
    step = max(1.0, np.sqrt(height * width / count))
    rows, columns = (np.arange(rng.uniform(0, min(step, side)), side, step).astype(int) for side in shape)
    return (rows[:, None] * width + columns).ravel()


def _lines(shape: tuple[int, ...], count: int, rng: np.random.Generator) -> np.ndarray:
    """Nearly horizontal lines at equal distances, with points at equal distances on each, the first at random."""
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
    """Columns of the points on each line, L x P; those beyond the image are left out later."""
    return rng.uniform(0, step, (lines, 1)) + np.arange(0, width, step)[None]


def _clusters(depth: np.ndarray, count: int, rng: np.random.Generator) -> np.ndarray:
    """Normally distributed points around pixels with depth, as many as are asked for if there is room around them."""
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
