"""The base class of the readers of recorded video: files of frames, source frames, and sampled points."""

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
"""Offsets of at least this are meant as frames: multiplied by a gap, source frames would not overlap the target."""

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class FrameFiles:
    """The files of one frame.

    Args:
        image: the colour image.
        sparse_depth: the sparse points; None if they are sampled from the ground truth.
        ground_truth: the true depth.
        scale: stored depth values per metre in PNG files.
        sparse_scale: stored depth values per metre of the sparse points; None for `scale`.
    """

    image: Path
    sparse_depth: Path | None = None
    ground_truth: Path | None = None
    scale: float = 256.0
    sparse_scale: float | None = None

    @property
    def has_depth(self) -> bool:
        """Whether there are sparse points; a frame without them can be a source frame, but not a target."""
        return self.sparse_depth is not None or self.ground_truth is not None


Frames = dict[str, dict[str, FrameFiles]]
"""The frames of each sequence, by their names in the order of time."""


class Clip(NamedTuple):
    """A part of a sequence that belongs to a split.

    Args:
        sequence: the sequence's name.
        targets: names of the target frames, in the order of time.
        frames: names of the possible source frames, in the order of time; empty for single frames.
        gap: factor by which offsets are multiplied.
    """

    sequence: str
    targets: Sequence[str]
    frames: Sequence[str] = ()
    gap: int = 1


class RecordedVideo(Reader):
    """The base class of readers of recorded video. Subclasses are frozen dataclasses that list frames and splits.

    Attributes:
        density: number of sparse points as a fraction of the pixels, if they are sampled.
    """

    density: float = SparseSettings.density

    @abstractmethod
    def _find(self) -> Frames:
        """List the files of all frames; called once, on first use."""

    @abstractmethod
    def _clips(self, split: str) -> list[Clip]:
        """The clips of one of `SPLITS`, empty if there is no such split.

        It is called once for each split, and reports excluded frames by `report_skipped`.
        """

    @abstractmethod
    def _expected(self, split: str) -> str:
        """The files or the option that a missing split needs, for the end of a sentence."""

    def triplets(self, split: str, offsets: tuple[int, ...]) -> list[Triplet]:
        """The targets of a split with their source frames, at the offsets multiplied by `Clip.gap`.

        Single frames, and frames of which a source frame does not exist, have no source frames.
        """
        if split not in SPLITS:
            raise DeuxError(f"there is no split {split!r}: {near_matches(split, SPLITS)}")
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
        """All frames with depth, including those between two splits."""
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
        """H x W float32 metres, 0 = none; sampled at corners of the image if there is no file of points."""
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
        """H x W float32 metres, 0 = none; None for a frame without ground truth."""
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
        """The clips of each split, cached on first use."""
        return {}


def check_video_options(gap: int | None, scale: float | None = None, density: float = SparseSettings.density) -> None:
    """Raise DeuxError if one of the options that several readers have is out of range."""
    check_range("data.density", density, 1e-6, 1)
    if gap is not None:
        check_range("data.gap", gap, 1)
    if scale is not None:
        check_range("data.scale", scale, 0, ends=False)


def held_out(names: Sequence[str], count: int, what: str, folder: Path) -> tuple[list[str], list[str]]:
    """Divide sequences into those for training and the last `count`, which are held out for validation.

    Raises:
        DeuxError: no sequence would be left for training.
    """
    if count >= len(names) > 0:
        raise DeuxError(
            f"data.validation={count} leaves nothing to train on: {folder} has {len(names)} {what} for training."
        )
    first = len(names) - count
    return list(names[:first]), list(names[first:])


def report_skipped(what: object, usable: int, skipped: Mapping[str, int]) -> None:
    """Log the number of usable frames of a folder, list or split, and of excluded frames by reason."""
    reasons = ", ".join(f"{count} {reason}" for reason, count in skipped.items() if count)
    total = usable + Counter(skipped).total()
    if reasons:
        log.warning("%s: %d of %d frames: %s", what, usable, total, reasons)
    else:
        log.info("%s: %d frames", what, total)


def _check_reach(gap: int, offsets: tuple[int, ...]) -> None:
    """Raise DeuxError if offsets that are meant as frames would be multiplied by a gap."""
    farthest = max(map(abs, offsets), default=0)
    if gap > 1 and farthest >= MANY_FRAMES:
        raise DeuxError(
            f"training.offsets={list(offsets)} and data.gap={gap} put source frames {gap * farthest} frames away: set "
            "data.gap=1 to use the offsets as frames, or training.offsets=[-1,1] to use frames one gap away."
        )


def _sources(frames: Sequence[str], index: int | None, steps: Sequence[int]) -> list[str] | None:
    """The frames at the given distances from the one at `index`; None if one of them does not exist."""
    if index is None or any(not 0 <= index + step < len(frames) for step in steps):
        return None
    return [frames[index + step] for step in steps]
