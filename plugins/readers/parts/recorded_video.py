"""What the readers of recorded video have in common: frames by their files, source frames, and sampled points."""

import logging
from abc import abstractmethod
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

import numpy as np

from deux.collection.sparse import SparseSettings, sample_sparse
from deux.contracts import FrameReference, MissingSplit, Reader, Triplet
from deux.contracts.reader import SPLITS
from deux.errors import DeuxError, check_range, image_size, near_matches
from deux.io.camera_files import read_any_depth, read_any_image

MANY_FRAMES = 10
"""An offset that is as large counts frames: a gap on top of it would take frames that show other things."""

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class FrameFiles:
    """The files of one frame.

    Args:
        image: the colour image.
        sparse_depth: the sparse points; None where they are sampled from the ground truth.
        ground_truth: the true depth.
        scale: stored depth values per metre, in PNG files.
        sparse_scale: the same of the sparse points; None for `scale`.
    """

    image: Path
    sparse_depth: Path | None = None
    ground_truth: Path | None = None
    scale: float = 256.0
    sparse_scale: float | None = None

    @property
    def has_depth(self) -> bool:
        """Whether there are sparse points; a frame without them can be a source frame, but no target."""
        return self.sparse_depth is not None or self.ground_truth is not None


Frames = dict[str, dict[str, FrameFiles]]
"""The frames of each sequence, by their names in the order of time."""


class Clip(NamedTuple):
    """A part of a sequence that belongs to a split.

    Args:
        sequence: the sequence's name.
        targets: names of the target frames, in the order of time.
        frames: names of the frames among which source frames are counted, in the order of time; none where the
            sequence is no video and its frames stand alone.
        gap: source frames are so many times as far from the target as the offsets say.
    """

    sequence: str
    targets: Sequence[str]
    frames: Sequence[str] = ()
    gap: int = 1


class RecordedVideo(Reader):
    """A reader of recorded video. A subclass is a frozen dataclass that finds the frames and divides them into splits.

    Attributes:
        density: number of sparse points as a fraction of the pixels, where they are sampled.
    """

    density: float = SparseSettings.density

    @abstractmethod
    def _find(self) -> Frames:
        """List the frames' files; called once, with the first frame that is asked for."""

    @abstractmethod
    def _clips(self, split: str) -> list[Clip]:
        """The parts of the sequences that make up one of `SPLITS`, none if there is no such split.

        It is called once for each, and reports what it leaves out by `report_skipped`.
        """

    @abstractmethod
    def _expected(self, split: str) -> str:
        """Which files, or which option, would make up a split that has no frames: the end of a sentence."""

    def triplets(self, split: str, offsets: tuple[int, ...]) -> list[Triplet]:
        """The split's targets with their source frames, `Clip.gap` times as far away as the offsets say.

        Frames of a video that lack a source frame, and single frames, come without source frames.
        """
        if split not in SPLITS:
            raise DeuxError(f"there is no split called {split!r}: {near_matches(split, SPLITS)}")
        found = []
        if split not in self._divided:
            self._divided[split] = self._clips(split)
        for clip in self._divided[split]:
            _check_reach(clip.gap, offsets)
            position = {name: index for index, name in enumerate(clip.frames)}
            for name in clip.targets:
                sources = _sources(clip.frames, position.get(name), [clip.gap * offset for offset in offsets])
                found.append(
                    Triplet(
                        FrameReference(clip.sequence, name),
                        tuple(FrameReference(clip.sequence, source) for source in sources or ()),
                    )
                )
        if not found:
            raise MissingSplit(
                f"{self.folder} has no {split} frames with depth and source frames: {self._expected(split)}"
            )
        return found

    def frames(self) -> list[FrameReference]:
        """Every frame that has depth, those between two splits included."""
        found = [
            FrameReference(sequence, name)
            for sequence, frames in self._frames.items()
            for name, files in frames.items()
            if files.has_depth
        ]
        if not found:
            raise DeuxError(f"{self.folder} has no frames with depth.")
        return found

    def image(self, frame: FrameReference) -> np.ndarray:
        """H x W x 3 uint8."""
        return read_any_image(self._files(frame).image)

    def sparse_depth(self, frame: FrameReference) -> np.ndarray:
        """H x W float32 metres, 0 = none; at corners of the image where there is no file of points."""
        files = self._files(frame)
        if files.sparse_depth is not None:
            return read_any_depth(files.sparse_depth, files.sparse_scale or files.scale)
        depth = self.ground_truth(frame)
        if depth is None:
            raise DeuxError(f"{self.folder} has no depth of frame {frame.name} of {frame.sequence}.")
        image = self.image(frame)
        if image.shape[:2] != depth.shape:
            raise DeuxError(
                f"Frame {frame.name} of {frame.sequence} in {self.folder} has an image of {image_size(image.shape)} "
                f"pixels and depth of {image_size(depth.shape)}: depth must be registered to the image, pixel by pixel."
            )
        return sample_sparse(image, depth, SparseSettings(self.density))

    def ground_truth(self, frame: FrameReference) -> np.ndarray | None:
        """H x W float32 metres, 0 = none; None for a frame without."""
        files = self._files(frame)
        return None if files.ground_truth is None else read_any_depth(files.ground_truth, files.scale)

    def _files(self, frame: FrameReference) -> FrameFiles:
        try:
            return self._frames[frame.sequence][frame.name]
        except KeyError:
            raise DeuxError(f"{self.folder} has no frame {frame.name} of {frame.sequence}.") from None

    @cached_property
    def _frames(self) -> Frames:
        return self._find()

    @cached_property
    def _divided(self) -> dict[str, list[Clip]]:
        """The clips of the splits that have been asked for."""
        return {}


def check_video_options(gap: int | None, scale: float | None = None, density: float = SparseSettings.density) -> None:
    """Raise DeuxError if an option that several readers have is out of its range."""
    check_range("data.density", density, 1e-6, 1)
    if gap is not None:
        check_range("data.gap", gap, 1)
    if scale is not None:
        check_range("data.scale", scale, 0, ends=False)


def held_out(names: Sequence[str], count: int, what: str, folder: Path) -> tuple[list[str], list[str]]:
    """Divide sequences into those to train on and the last `count`, which are kept for validation.

    Raises:
        DeuxError: no sequence would be left to train on.
    """
    if count >= len(names) > 0:
        raise DeuxError(
            f"data.validation={count} leaves nothing to train on: {folder} has {len(names)} {what} for training."
        )
    kept = len(names) - count
    return list(names[:kept]), list(names[kept:])


def report_skipped(what: object, usable: int, skipped: Mapping[str, int]) -> None:
    """Log how many frames of a folder, list or split are usable, and how many are not, for which reasons."""
    reasons = ", ".join(f"{count} {reason}" for reason, count in skipped.items() if count)
    total = usable + Counter(skipped).total()
    if reasons:
        log.warning("%s: %d of %d frames: %s", what, usable, total, reasons)
    else:
        log.info("%s: %d frames", what, total)


def _check_reach(gap: int, offsets: tuple[int, ...]) -> None:
    """Refuse offsets that are meant as frames, such as those of the published experiments, beside a gap."""
    farthest = max(map(abs, offsets), default=0)
    if gap > 1 and farthest >= MANY_FRAMES:
        raise DeuxError(
            f"training.offsets={list(offsets)} and data.gap={gap} make source frames {gap * farthest} frames away: "
            "data.gap=1 takes the offsets as frames, or training.offsets=[-1,1] takes frames that are a gap away."
        )


def _sources(frames: Sequence[str], index: int | None, steps: Sequence[int]) -> list[str] | None:
    """The frames at the given distances from the one at `index`; None if one is not there."""
    if index is None or any(not 0 <= index + step < len(frames) for step in steps):
        return None
    return [frames[index + step] for step in steps]
