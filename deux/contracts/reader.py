"""The contract of a reader: frames on disk, recorded or collected, in somebody's layout."""

import re
from abc import ABC, abstractmethod
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np

from deux.errors import DeuxError

SPLITS = ("train", "validation", "test")
"""The splits that a folder may have."""


class MissingSplit(DeuxError):
    """A folder has no such split, or the split no frame; all its files may be sound.

    Who can do without a split, such as a training without validation, catches this and no other error.
    """


class FrameReference(NamedTuple):
    """One frame of a folder, by name.

    Args:
        sequence: the name of its sequence.
        name: its own name, unique within the sequence; names sort in the order of time where numbers in them count by
            their value (`deux.io.layout.natural_order`).
    """

    sequence: str
    name: str


class Triplet(NamedTuple):
    """A target frame and the source frames that it is rebuilt from.

    Args:
        target: frame t.
        sources: of the same sequence; t-1 and t-2 in collected datasets. None of a frame that lacks one of them, which
            is evaluated all the same; a training that compares frames leaves it out.
    """

    target: FrameReference
    sources: tuple[FrameReference, ...]


class Neighbourhood(NamedTuple):
    """A target frame and the frames around it, of which source frames can be chosen.

    Args:
        target: frame t.
        frames: frames of the same sequence, by their distance from the target in time, in frames.
    """

    target: FrameReference
    frames: Mapping[int, FrameReference]


class Reader(ABC):
    """Reads the frames of one folder: images, the camera's matrix, sparse points, and truth and poses if there are any.

    A reader is made as `cls(folder, **options)` and keeps the folder under that name; further parameters of the
    constructor are its options, each with a default; one that names a file or folder is annotated `Path`, and what lies
    there counts as a part of the frames. Making one reads no pixel. Readers are sent to worker processes,
    and what is cached of frames is found by its reader, so those that were made alike must be equal and have one hash,
    as a frozen dataclass does.

    All methods raise `DeuxError`, which names the file, where one is missing, damaged or of another kind.
    """

    folder: Path

    @abstractmethod
    def triplets(self, split: str, offsets: tuple[int, ...]) -> list[Triplet]:
        """The targets of a split with their source frames, in the order of the split.

        Args:
            split: "train", "validation" or "test".
            offsets: the source frames, in frames from the target, where the folder does not list them itself. A target
                that lacks one of them, at the end of a sequence or on its own, has no source frames.

        Raises:
            MissingSplit: the folder has no such split, or the split no frame.
        """

    def neighbourhoods(self, split: str, reach: int) -> list[Neighbourhood]:
        """The targets of a split with up to `reach` frames before and after each, in the order of the split.

        A reader that lists each target's source frames itself gives these.

        Raises:
            MissingSplit: as `triplets`.
        """
        found: dict[FrameReference, dict[int, FrameReference]] = {}
        for step in (step for distance in range(1, reach + 1) for step in (-distance, distance)):
            for target, sources in self.triplets(split, (step,)):
                around = found.setdefault(target, {})
                for number, source in enumerate(sources, start=1):
                    if source not in around.values():
                        around[step * number] = source
        return [Neighbourhood(target, around) for target, around in found.items()]

    def frames(self) -> list[FrameReference]:
        """Every frame that has sparse points, whichever split it belongs to, each sequence's in the order of time.

        By default these are the targets of all splits, which is right where each sequence lies in one split.

        Raises:
            MissingSplit: there is no frame at all.
        """
        found: dict[FrameReference, None] = {}
        missing: MissingSplit | None = None
        for split in SPLITS:
            try:
                found |= dict.fromkeys(target for target, _ in self.triplets(split, (-1,)))
            except MissingSplit as error:
                missing = missing or error
        if missing is not None and not found:
            raise missing
        return [*found]

    def place(self, frame: FrameReference) -> str:
        """The scene, or floor of a scene, that a frame shows; errors are kept by it, and intervals are over these.

        By default it is the frame's sequence. Free viewpoints are sequences of one frame, <place>-view0012, of which a
        scene has many.
        """
        return re.sub(r"-view\d+$", "", frame.sequence)

    def chosen_triplets(self, split: str) -> list[Triplet] | None:
        """The targets of a split with source frames chosen by parallax; None where the folder has no list of these."""
        return None

    @abstractmethod
    def image(self, frame: FrameReference) -> np.ndarray:
        """The colour image, H x W x 3 uint8."""

    @abstractmethod
    def intrinsics(self, frame: FrameReference) -> np.ndarray:
        """The matrix of the camera that took the image, for pixel centres at integers, 3 x 3 float64."""

    @abstractmethod
    def sparse_depth(self, frame: FrameReference) -> np.ndarray:
        """The sparse points, H x W float32 metres, 0 = none; the same at each call, if they are sampled."""

    def ground_truth(self, frame: FrameReference) -> np.ndarray | None:
        """The true depth, H x W float32 metres, 0 = none; None where the folder has none."""
        return None

    def pose(self, frame: FrameReference) -> np.ndarray | None:
        """The camera's pose, camera-to-world, 4 x 4 float64; None where the folder has none."""
        return None
