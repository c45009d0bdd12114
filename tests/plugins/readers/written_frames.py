"""Frames as files, written without anything that reads them, and the suite of readers that sample their points."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from PIL import Image

from deux.contracts import FrameReference, Reader, Triplet
from deux.testing.readers import ReaderSuite, RecordedFrame, Recordings, record

DENSITY = 0.05
"""Of the points that `SampledSuite` expects."""


def save_image(path: Path, image: np.ndarray) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(image).save(path, **({"quality": 95} if path.suffix == ".jpg" else {}))


def save_depth(path: Path, depth: np.ndarray, scale: float = 256.0) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(np.rint(depth.astype(np.float64) * scale).astype(np.uint16)).save(path)


def save_matrix(path: Path, matrix: np.ndarray) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    np.savetxt(path, matrix, fmt="%.18e")


def in_multiples_of(scale: float, recordings: Recordings) -> Recordings:
    """The recordings with depth that files of that many values per metre hold exactly."""
    return {name: [_rounded(frame, scale) for frame in frames] for name, frames in recordings.items()}


def _rounded(frame: RecordedFrame, scale: float) -> RecordedFrame:
    depth = (np.rint(frame.ground_truth * scale) / scale).astype(np.float32)
    sparse = np.where(frame.sparse_depth > 0, depth, np.float32(0.0))
    return replace(frame, sparse_depth=sparse, ground_truth=depth)


def with_sources(reader: Reader, offsets: tuple[int, ...], split: str = "train") -> list[Triplet]:
    """The triplets of a split that can be rebuilt: those that a training of an unsupervised model takes."""
    return [triplet for triplet in reader.triplets(split, offsets) if triplet.sources]


def video(frames: int) -> Sequence[RecordedFrame]:
    """A walk of that many frames, 24 x 16 pixels."""
    return record(frames)["corridor"]


class SampledSuite(ReaderSuite):
    """Sparse points are sampled from the ground truth: which pixels they are is checked by number and value alone."""

    has_poses = False

    def _check(self, reader: Reader, frame: FrameReference, recorded: RecordedFrame) -> None:
        sparse = reader.sparse_depth(frame)
        assert (sparse > 0).sum() == round(DENSITY * sparse.size)
        np.testing.assert_array_equal(sparse, reader.sparse_depth(frame))
        expected = np.where(sparse > 0, recorded.ground_truth, np.float32(0.0))
        super()._check(reader, frame, replace(recorded, sparse_depth=expected))
