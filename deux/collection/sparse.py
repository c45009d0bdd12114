"""Stage 2: sparse depth, as a visual odometry system would have it, at Harris corners."""

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
"""Corners are spread over a grid of this many cells along either side of the image."""

_QUALITY = 1e-4
"""A corner is strong from this part of the image's greatest response on; weaker ones come later."""

_SHARE = 256
"""Frames that a pool of threads is given at once."""


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
    """Number of sparse points that a frame of H x W pixels is to have."""
    return round(settings.density * shape[0] * shape[1])


def sample_sparse(image: np.ndarray, depth: np.ndarray, settings: SparseSettings) -> np.ndarray:
    """Keep the depth at the image's Harris corners (Harris and Stephens, 1988).

    Corners are local maxima of the response where depth is known. They are taken in turn from the cells of a
    grid, each cell's strongest first and weak ones later, so that one rich texture does not take them all; other
    pixels fill up the count, so that it is reached wherever enough pixels have depth. The result depends on the
    arguments alone: exploration and the stored files see the same points.

    The published set-up code of the depth models instead clusters the pixels of most negative response (edges, by
    an ascending sort) with scikit-learn's MiniBatchKMeans. It is not reproduced here.

    Args:
        image: H x W x 3 uint8.
        depth: H x W float32 metres, 0 = none.
        settings: how many points.

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
    # The noise is far below any corner: it only decides, evenly, between the pixels of a surface without texture.
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
        settings: how many points.
        progress: told the number of frames.

    Raises:
        DeuxError: an image or depth map cannot be read, or the disk is full.
    """
    tasks = [(paths, frame) for paths in found for frame in _unsampled(paths)]

    def sample(task: tuple[SequencePaths, str]) -> None:
        _sample_frame(*task, settings)

    with ThreadPoolExecutor(os.cpu_count()) as pool:  # decoding and encoding release the interpreter's lock
        # Not all at once: the pool keeps 2 kB for each frame that it is given.
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
    # The release stores validity as a depth map of ones.
    write_depth(paths.file("validity_map", frame), (sparse > 0).astype(np.float32))


def _spread_maxima(score: np.ndarray, count: int) -> np.ndarray:
    """Flat indices of `count` pixels of finite score (or all of them, if fewer), in the order of preference."""
    maxima = np.flatnonzero((score == cv2.dilate(score, np.ones((3, 3)))) & np.isfinite(score))
    maxima = maxima[np.argsort(-score.flat[maxima], kind="stable")]
    turn = _turn_in_cell(maxima, score.shape)
    weak = score.flat[maxima] < _QUALITY
    # Weak ones wait for as many turns as an even spread would take; among equals the better score goes first.
    handicap = -(-count // _GRID**2)
    chosen = maxima[np.argsort(turn + weak * handicap, kind="stable")[:count]]
    if len(chosen) == count:
        return chosen
    others = np.isfinite(score).ravel()
    others[chosen] = False
    left = np.flatnonzero(others)
    # Evenly spread rather than by score, whose next best are all neighbours of the maxima.
    preferred = np.argsort(_tie_breaker(score.shape).flat[left], kind="stable")[: count - len(chosen)]
    return np.concatenate([chosen, left[preferred]])


def _turn_in_cell(pixels: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """How many pixels (flat indices, best first) of the same grid cell come before each of the pixels."""
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
