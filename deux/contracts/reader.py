"""The contract of a reader: frames on disk, recorded or collected, in somebody's layout."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from pathlib import Path

import numpy as np


@dataclass(frozen=True)
class FrameReference:
    """One frame of a folder, by name.

    Args:
        sequence: the name of its sequence.
        name: its own name, unique within the sequence; names sort in the order of time.
    """

    sequence: str
    name: str


@dataclass(frozen=True)
class Triplet:
    """A target frame and the source frames that it is rebuilt from.

    Args:
        target: frame t.
        sources: of the same sequence; t-1 and t-2 in collected datasets.
    """

    target: FrameReference
    sources: tuple[FrameReference, ...]


class Reader(ABC):
    """Reads the frames of one folder.

    A reader is made as `cls(folder, **options)` and keeps the folder under that name. Making one reads no pixel.
    """

    folder: Path

    @abstractmethod
    def triplets(self, split: str, offsets: tuple[int, ...]) -> list[Triplet]:
        """The targets of a split with their source frames, in the order of the split.

        Args:
            split: "train", "validation" or "test".
            offsets: the source frames, in frames from the target, where the folder does not list them itself.

        Raises:
            DeuxError: the folder has no such split, or the split no frame.
        """

    @abstractmethod
    def image(self, frame: FrameReference) -> np.ndarray:
        """The colour image, H x W x 3 uint8. Raises DeuxError, which names the file, as all that follow do."""

    @abstractmethod
    def intrinsics(self, frame: FrameReference) -> np.ndarray:
        """The camera's matrix, 3 x 3 float64."""

    @abstractmethod
    def sparse_depth(self, frame: FrameReference) -> np.ndarray:
        """The sparse points, H x W float32 metres, 0 = none."""

    def ground_truth(self, frame: FrameReference) -> np.ndarray | None:
        """The true depth, H x W float32 metres, 0 = none; None where the folder has none."""
        return None

    def pose(self, frame: FrameReference) -> np.ndarray | None:
        """The camera's pose, camera-to-world, 4 x 4 float64; None where the folder has none."""
        return None
