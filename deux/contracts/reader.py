"""The contract of a reader: it reads recorded or collected frames from a folder in some layout."""

import re
from abc import ABC, abstractmethod
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np

from deux.errors import DeuxError

SPLITS = ("train", "validation", "test")
"""The splits that a folder may contain."""


class MissingSplit(DeuxError):
    """A folder has no such split, or the split no frame; all its files may be sound.

    Who can do without a split, such as a training without validation, catches this and no other error.
    """


class FrameReference(NamedTuple):
    """The name of one frame of a folder.

    Args:
        sequence: the name of its sequence.
        name: its own name, unique within the sequence. In natural order (`deux.io.layout.natural_order`), names are in
            the order of time.
    """

    sequence: str
    name: str


class Triplet(NamedTuple):
    """A target frame and the source frames from which it is reconstructed.

    Args:
        target: frame t.
        sources: frames of the same sequence; t-1 and t-2 in collected datasets. Empty if one of them does not exist:
            such a target is evaluated, but not used for training with reconstructions.
    """

    target: FrameReference
    sources: tuple[FrameReference, ...]


class Neighbourhood(NamedTuple):
    """A target frame and the frames around it, from which source frames can be chosen.

    Args:
        target: frame t.
        frames: frames of the same sequence, by their offset from the target, in frames.
    """

    target: FrameReference
    frames: Mapping[int, FrameReference]


class Reader(ABC):
    """Reads the frames of one folder: images, intrinsics and sparse points; true depth and poses if there are any.

    The constructor is called as `cls(folder, **options)`, each option with a default, and keeps `folder` as an
    attribute. It reads no pixels. An option that names a file or folder is annotated `Path`; that file's content then
    counts as part of the frames. Readers are sent to worker processes and are keys of frame caches: readers made with
    equal arguments must be equal and have equal hashes, as frozen dataclasses do.

    All methods raise a `DeuxError` that names the file if one is missing, damaged or of the wrong kind.
    """

    folder: Path

    @abstractmethod
    def triplets(self, split: str, offsets: tuple[int, ...]) -> list[Triplet]:
        """List the targets of a split with their source frames, in the order of the split.

        Args:
            split: "train", "validation" or "test".
            offsets: the source frames as offsets from the target, in frames; unused if the folder lists source frames
                itself. A target for which one of them does not exist has no source frames.

        Raises:
            MissingSplit: the folder has no such split, or the split has no frames.
        """

    def neighbourhoods(self, split: str, reach: int) -> list[Neighbourhood]:
        """List the targets of a split with up to `reach` frames before and after each, in the order of the split.

        If the folder lists source frames itself, these take the place of the frames around the target.

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
        """List every frame that has sparse points, of all splits, each sequence in the order of time.

        The default lists the targets of all splits, which is correct if no sequence is in two splits.

        Raises:
            MissingSplit: there is no frame in any split.
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
        """The scene, or floor of a scene, that a frame shows; errors and their intervals are computed per place.

        The default is the frame's sequence, without the suffix of free viewpoints: these are sequences of one frame
        called <place>-view0012, many for each place.
        """
        return re.sub(r"-view\d+$", "", frame.sequence)

    def chosen_triplets(self, split: str) -> list[Triplet] | None:
        """The targets of a split with source frames chosen by parallax; None if the folder has no such list."""
        return None

    @abstractmethod
    def image(self, frame: FrameReference) -> np.ndarray:
        """The colour image, H x W x 3 uint8."""

    @abstractmethod
    def intrinsics(self, frame: FrameReference) -> np.ndarray:
        """The matrix of the camera that took the image, for pixel centres at integers, 3 x 3 float64."""

    @abstractmethod
    def sparse_depth(self, frame: FrameReference) -> np.ndarray:
        """The sparse points, H x W float32 metres, 0 = none; the same at every call, also if they are sampled."""

    def ground_truth(self, frame: FrameReference) -> np.ndarray | None:
        """The true depth, H x W float32 metres, 0 = none; None if the folder has none."""
        return None

    def pose(self, frame: FrameReference) -> np.ndarray | None:
        """The camera's pose, camera-to-world, 4 x 4 float64; None if the folder has none."""
        return None
