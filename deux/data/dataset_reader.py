"""The reader `data=deux`: datasets collected by deux, and the VOID release, whose layout they have."""

import logging
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path

import numpy as np

from deux.collection.specification import place_of_sequence
from deux.contracts import FrameReference, MissingSplit, Neighbourhood, Reader, Triplet
from deux.errors import DeuxError, check_range, counted, near_matches, plural
from deux.io.atomic import read_bytes
from deux.io.calibration import read_intrinsics, read_pose
from deux.io.camera_files import read_any_image
from deux.io.file_names import is_file_name
from deux.io.images import DEPTH_SCALE, read_depth
from deux.io.layout import (
    MANIFEST,
    TRIPLET_LISTS,
    SequencePaths,
    list_file,
    neighbours,
    sequences,
    without_suffix,
)
from deux.log_once import warn_once

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class DatasetReader(Reader):
    """Reads the layout of the VOID release, with or without the triplet list that deux adds (`deux.io.layout`).

    A pixel of `sparse_depth/` is valid if it is above 0; `validity_map/` is not read. Images are PNG or JPEG files.

    Args:
        folder: the dataset.
        scale: stored values per metre of the 16-bit depth files; 1000 for millimetres.
        ground_truth_scale: the same for `ground_truth/`; by default `scale`.
        validation: names of sequences that are moved from the training split to the validation split, for a dataset
            without a validation split.

    Raises:
        DeuxError: the folder has no sequences in this layout, a sequence in `validation` does not exist, or a scale is
            not above 0.
    """

    folder: Path
    scale: float = DEPTH_SCALE
    ground_truth_scale: float | None = None
    validation: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if not (self.folder / "data").is_dir():
            raise DeuxError(f"{self.folder} is no dataset: it has no folder data/ with sequences in VOID's layout.")
        check_range("data.scale", self.scale, 0, ends=False)
        if self.ground_truth_scale is not None:
            check_range("data.ground_truth_scale", self.ground_truth_scale, 0, ends=False)
        for name in self.validation:
            if not (self.folder / "data" / name).is_dir():
                there = (path.name for path in (self.folder / "data").iterdir() if path.is_dir())
                raise DeuxError(f"data.validation: {self.folder} has no sequence {name!r}: {near_matches(name, there)}")

    def triplets(self, split: str, offsets: tuple[int, ...]) -> list[Triplet]:
        """Read the triplets from the triplet list of collected datasets, else from the split's image list.

        An image list, as in the VOID release, names only the targets. Their source frames are then the frames of the
        sequence at the offsets, whether these are listed or not. A target for which one of them does not exist has no
        source frames.
        """
        found = self._divided(split, self._listed(self._listed_split(split), offsets))
        if not found:
            raise MissingSplit(f"The {split} split of {self.folder} has no frames.")
        return found

    def chosen_triplets(self, split: str) -> list[Triplet] | None:
        """The second triplet list of collected datasets; None if the folder has no such list or it is empty."""
        listed = list_file(self.folder, self._listed_split(split), TRIPLET_LISTS["baseline"])
        if not listed.exists():
            return None
        return self._divided(split, self._listed_triplets(_lines(listed))) or None

    def neighbourhoods(self, split: str, reach: int) -> list[Neighbourhood]:
        """The listed targets with the frames around them that have a readable pose, whether these are listed or not."""
        targets = [target for target, _ in self.triplets(split, (-1,))]
        listed = set(targets)
        places: dict[FrameReference, tuple[list[FrameReference], int, set[FrameReference]]] = {}
        for sequence in dict.fromkeys(target.sequence for target in targets):
            names = self._paths(FrameReference(sequence, "")).frames()
            frames = [FrameReference(sequence, name) for name in names]
            usable = {frame for frame in frames if frame in listed or self._pose_problem(frame) is None}
            places |= {frame: (frames, number, usable) for number, frame in enumerate(frames)}
        found = []
        for target in targets:
            frames, number, usable = places[target]
            steps = range(max(-reach, -number), min(reach, len(frames) - 1 - number) + 1)
            around = {step: frames[number + step] for step in steps if step and frames[number + step] in usable}
            found.append(Neighbourhood(target, around))
        return found

    def frames(self) -> list[FrameReference]:
        """Every frame that has an image and sparse depth, listed or not."""
        found = []
        for paths in sequences(self.folder):
            sparse = paths.names("sparse_depth")
            found += [FrameReference(paths.name, name) for name in paths.frames() if name in sparse]
        if not found:
            raise DeuxError(f"{self.folder} has no frames with sparse depth.")
        return found

    def place(self, frame: FrameReference) -> str:
        """The floor of a scene in a collected dataset, where each episode and each free viewpoint is a sequence."""
        return place_of_sequence(frame.sequence) if self._is_collected else super().place(frame)

    def image(self, frame: FrameReference) -> np.ndarray:
        """H x W x 3 uint8."""
        return read_any_image(self._paths(frame).recorded_image(frame.name))

    def intrinsics(self, frame: FrameReference) -> np.ndarray:
        """The sequence's K.txt, 3 x 3 float64."""
        return read_intrinsics(self._paths(frame).intrinsics)

    def sparse_depth(self, frame: FrameReference) -> np.ndarray:
        """H x W float32 metres, 0 = none."""
        return read_depth(self._paths(frame).file("sparse_depth", frame.name), self.scale)

    def ground_truth(self, frame: FrameReference) -> np.ndarray | None:
        """H x W float32 metres, 0 = none; None if the sequence has no folder `ground_truth/`."""
        file = self._optional(frame, "ground_truth")
        return None if file is None else read_depth(file, self.ground_truth_scale or self.scale)

    def pose(self, frame: FrameReference) -> np.ndarray | None:
        """4 x 4 float64; None if the sequence has no folder `absolute_pose/`."""
        file = self._optional(frame, "absolute_pose")
        return None if file is None else read_pose(file)

    @cached_property
    def _is_collected(self) -> bool:
        """Whether deux collected the dataset: only then do the names of sequences contain the name of their scene."""
        return (self.folder / MANIFEST).is_file()

    def _optional(self, frame: FrameReference, kind: str) -> Path | None:
        """The frame's file of a kind; None if its sequence has no folder of that kind."""
        file = self._paths(frame).file(kind, frame.name)
        return file if file.parent.is_dir() else None

    def _paths(self, frame: FrameReference) -> SequencePaths:
        return SequencePaths(self.folder / "data" / frame.sequence)

    def _listed_split(self, split: str) -> str:
        """The split in whose list files the frames of this split are."""
        return "train" if split == "validation" and self.validation else split

    def _divided(self, split: str, found: list[Triplet]) -> list[Triplet]:
        """The listed triplets that belong to this split, after `validation` has been split off the training split."""
        if self.validation and self._listed_split(split) == "train":
            return [one for one in found if (one.target.sequence in self.validation) == (split == "validation")]
        return found

    def _listed(self, split: str, offsets: tuple[int, ...]) -> list[Triplet]:
        """The triplets of a split that has list files."""
        listed = list_file(self.folder, split, TRIPLET_LISTS["recent"])
        if listed.exists():
            return self._listed_triplets(_lines(listed))
        if list_file(self.folder, split, "image").exists():
            return self._neighbours(split, _lines(list_file(self.folder, split, "image")), offsets)
        there = sorted({path.name.rsplit("_image.txt")[0] for path in self.folder.glob("*_image.txt")})
        raise MissingSplit(
            f"{self.folder} has no {split} split, whose frames {split}_image.txt would list; it has "
            f"{', '.join(there) or 'no list files at all'}."
        )

    def _frame(self, line: str) -> FrameReference:
        """Parse the path of an image; the folder before `data/` may differ from the dataset's present folder."""
        parts = line.rsplit("/", 4)[-4:]  # pathlib would take most of the time that it takes to open a dataset
        if len(parts) < 4 or parts[0] != "data":
            raise DeuxError(
                f"{self.folder} lists {line}, where a path like data/<sequence>/image/<frame>.png is expected."
            )
        if not all(map(is_file_name, (parts[1], parts[3]))):
            raise DeuxError(f"{self.folder} lists {line}, which is not a valid file name.")
        return FrameReference(parts[1], without_suffix(parts[3]))

    def _listed_triplets(self, lines: Sequence[str]) -> list[Triplet]:
        """Parse the lines of a triplet list."""
        frame = cache(self._frame)  # most images are in three lines
        triplets = []
        for line in lines:
            target, *sources = map(frame, line.split("\t"))
            triplets.append(Triplet(target, tuple(sources)))
        return triplets

    def _neighbours(self, split: str, lines: Sequence[str], offsets: tuple[int, ...]) -> list[Triplet]:
        """The listed targets with the frames at the offsets.

        A listed frame with a damaged pose is an error when it is read. A frame that is not listed may have been left
        out because of its pose: it is used as a source frame only if the pose can be read.
        """
        targets = [self._frame(line) for line in lines]
        listed, there, sources = set(targets), set(), {}
        for sequence in dict.fromkeys(target.sequence for target in targets):
            frames = SequencePaths(self.folder / "data" / sequence).frames()
            there |= {FrameReference(sequence, name) for name in frames}
            for name, *others in neighbours(frames, offsets):
                sources[FrameReference(sequence, name)] = tuple(FrameReference(sequence, other) for other in others)
        self._check_images(split, listed - there)
        used = {source for target in targets for source in sources.get(target, ())}
        broken = {frame: problem for frame in sorted(used - listed) if (problem := self._pose_problem(frame))}
        if broken:
            warn_once(
                log,
                f"{counted(len(broken), 'frame')} of {self.folder} that no {split} list names "
                f"{plural('has', len(broken))} no usable pose and {plural('is', len(broken))} no source "
                f"{plural('frame', len(broken))}: {next(iter(broken.values()))}",
            )
        usable = {target: others for target, others in sources.items() if not broken.keys() & others}
        return [Triplet(target, usable.get(target, ())) for target in targets]

    def _check_images(self, split: str, missing: set[FrameReference]) -> None:
        """Raise DeuxError if listed frames have no image."""
        if missing:
            first = min(missing)
            raise DeuxError(
                f"{self._paths(first).file('image', first.name)}, which "
                f"{list_file(self.folder, split, 'image')} lists, is missing"
                f"{f', and so are {len(missing) - 1} more' if len(missing) > 1 else ''}."
            )

    def _pose_problem(self, frame: FrameReference) -> str | None:
        """The error message if the frame's pose cannot be read; None if it can or the sequence has no poses."""
        try:
            self.pose(frame)
        except DeuxError as error:
            return str(error)
        return None


def _lines(path: Path) -> list[str]:
    """The lines of a list file, without blank lines."""
    try:
        text = read_bytes(path).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise DeuxError(f"{path} is not a list of frames: it is not a text file.") from error
    return [line.strip() for line in text.splitlines() if line.strip()]
