"""Stage 2: sparse depth at Harris corners, as a visual odometry system would measure it."""

import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np

from deux.errors import check_range
from deux.io.atomic import make_folder
from deux.io.images import read_depth, read_image, write_depth
from deux.io.layout import SequencePaths
from deux.io.progress import Progress, ignore_progress

_GRID = 8
"""Number of cells along each side of the grid over which corners are spread."""

_QUALITY = 1e-4
"""Least response of a strong corner, relative to the image's maximum; weaker corners are chosen later."""

_SHARE = 256
"""Number of frames that are submitted to the thread pool at once."""


@dataclass(frozen=True)
class SparseSettings:
    """How many sparse points a frame has.

    Args:
        density: number of points as a fraction of the pixels; the paper's 1,500 of 400 x 400 by default.

    Raises:
        DeuxError: the density is not above 0, or above 1.
    """

    density: float = 1500 / 160000

    def __post_init__(self) -> None:
        check_range("sampling.density", self.density, 1e-6, 1)


def point_count(shape: tuple[int, int], settings: SparseSettings) -> int:
    """Number of sparse points to sample in a frame of H x W pixels."""
    return round(settings.density * shape[0] * shape[1])


def sample_sparse(image: np.ndarray, depth: np.ndarray, settings: SparseSettings) -> np.ndarray:
    """Keep the depth at the image's Harris corners (Harris and Stephens, 1988).

    Corners are local maxima of the response at pixels with depth. They are chosen from the cells of a grid in turn,
    the strongest of each cell first and weak ones later, so that not all lie on one rich texture. If there are too few,
    other pixels with depth are added. The result depends only on the arguments, so that exploration and stored files
    have the same points.

    The published set-up code of the depth models instead clusters the pixels of most negative response (edges, by
    an ascending sort) with scikit-learn's MiniBatchKMeans. It is not reproduced here.

    Args:
        image: H x W x 3 uint8.
        depth: H x W float32 metres, 0 = none.
        settings: number of points.

    Returns:
        H x W float32 metres, 0 = none.

    Example:
        >>> image = np.random.default_rng(0).integers(0, 255, (40, 40, 3), np.uint8)
        >>> points = sample_sparse(image, np.full((40, 40), 2.0, np.float32), SparseSettings(density=0.01))
        >>> int(np.count_nonzero(points)), points.max().item()
        (16, 2.0)
    """
    gray = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
    response = cv2.cornerHarris(gray, blockSize=3, ksize=3, k=0.04)
    # The noise is far below any corner's response and only breaks ties between pixels without texture.
    score = response / max(float(response.max()), 1e-12) + _tie_breaker(gray.shape)
    score[depth <= 0] = -np.inf
    chosen = _spread_maxima(score, point_count(gray.shape, settings))
    sparse = np.zeros_like(depth)
    sparse.flat[chosen] = depth.flat[chosen]
    return sparse


def sample_sequences(
    found: Sequence[SequencePaths], settings: SparseSettings, progress: Progress = ignore_progress
) -> None:
    """Write `sparse_depth` and `validity_map` of every frame that lacks them, from its image and ground truth.

    Args:
        found: the sequences.
        settings: number of points.
        progress: called with the number of frames.

    Raises:
        DeuxError: an image or depth map cannot be read, or the disk is full.
    """
    tasks = [(paths, frame) for paths in found for frame in _unsampled(paths)]

    def sample(task: tuple[SequencePaths, str]) -> None:
        _sample_frame(*task, settings)

    with ThreadPoolExecutor(os.cpu_count()) as pool:  # decoding and encoding release the GIL
        # In portions, since the pool keeps 2 kB for each submitted frame.
        shares = (tasks[first : first + _SHARE] for first in range(0, len(tasks), _SHARE))
        sampled = (done for share in shares for done in pool.map(sample, share))
        for number, _ in enumerate(sampled, start=1):
            progress("sparse depth", number, len(tasks))


def _unsampled(paths: SequencePaths) -> list[str]:
    """The frames of a sequence that have no validity map, which is written last."""
    done = paths.names("validity_map")
    return [frame for frame in paths.frames() if frame not in done]


def _sample_frame(paths: SequencePaths, frame: str, settings: SparseSettings) -> None:
    image, depth = read_image(paths.file("image", frame)), read_depth(paths.file("ground_truth", frame))
    sparse = sample_sparse(image, depth, settings)
    for kind in ("sparse_depth", "validity_map"):
        make_folder(paths.folder / kind)
    write_depth(paths.file("sparse_depth", frame), sparse)
    # VOID stores validity as a depth map of ones.
    write_depth(paths.file("validity_map", frame), (sparse > 0).astype(np.float32))


def _spread_maxima(score: np.ndarray, count: int) -> np.ndarray:
    """Flat indices of `count` pixels with finite score, or of all if there are fewer, in order of preference."""
    maxima = np.flatnonzero((score == cv2.dilate(score, np.ones((3, 3)))) & np.isfinite(score))
    maxima = maxima[np.argsort(-score.flat[maxima], kind="stable")]
    turn = _turn_in_cell(maxima, score.shape)
    weak = score.flat[maxima] < _QUALITY
    # Weak corners come after the number of turns that an even spread would need; ties are broken by score.
    handicap = -(-count // _GRID**2)
    chosen = maxima[np.argsort(turn + weak * handicap, kind="stable")[:count]]
    if len(chosen) == count:
        return chosen
    others = np.isfinite(score).ravel()
    others[chosen] = False
    left = np.flatnonzero(others)
    # In random order rather than by score, since the next best pixels are all neighbours of the maxima.
    preferred = np.argsort(_tie_breaker(score.shape).flat[left], kind="stable")[: count - len(chosen)]
    return np.concatenate([chosen, left[preferred]])


def _turn_in_cell(pixels: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """For each pixel (flat indices, best first), the number of earlier pixels in the same grid cell."""
    rows, columns = np.divmod(pixels, shape[1])
    cell = (rows * _GRID // shape[0] * _GRID + columns * _GRID // shape[1]).astype(np.uint8)
    order = np.argsort(cell, kind="stable")
    first = np.searchsorted(cell[order], np.arange(_GRID * _GRID, dtype=np.uint8))
    turn = np.empty(len(pixels), dtype=np.int64)
    turn[order] = np.arange(len(pixels)) - first[cell[order]]
    return turn


@lru_cache(maxsize=4)
def _tie_breaker(shape: tuple[int, int]) -> np.ndarray:
    """Noise in [0, 1e-6), always the same for one image size, H x W float32."""
    return np.random.default_rng(0).random(shape, dtype=np.float32) * np.float32(1e-6)
