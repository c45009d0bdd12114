"""`data=deux`: the datasets that deux collects, and the VOID release, whose layout they have."""

import logging
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, cached_property, lru_cache
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

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class DatasetReader(Reader):
    """Reads the layout of the VOID release, with or without the triplet list that deux adds (`deux.io.layout`).

    A point of `sparse_depth/` is valid where it is above 0; `validity_map/` is not read. Images are PNG or JPEG files.

    Args:
        folder: the dataset.
        scale: stored values per metre of the 16-bit depth files; 1000 for millimetres.
        ground_truth_scale: the same for `ground_truth/`; None for that of the sparse depth.
        validation: names of sequences of the training split that are kept out of it and make up the validation split,
            for a dataset that has none.

    Raises:
        DeuxError: the folder has no sequences in this layout, or not those that `validation` names, or a scale is not
            above 0.
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
        """Our own datasets list them. Elsewhere, as in the VOID release, the split's image list names the targets.

        The source frames are then those at the offsets in the sequence, whether a list names them or not. A target that
        lacks one of them has no source frames.
        """
        found = self._divided(split, self._listed(self._listed_split(split), offsets))
        if not found:
            raise MissingSplit(f"The {split} split of {self.folder} has no frames.")
        return found

    def chosen_triplets(self, split: str) -> list[Triplet] | None:
        """Those of our own datasets' second list; None elsewhere, and where that list is empty."""
        listed = list_file(self.folder, self._listed_split(split), TRIPLET_LISTS["baseline"])
        if not listed.exists():
            return None
        return self._divided(split, self._listed_triplets(_lines(listed))) or None

    def neighbourhoods(self, split: str, reach: int) -> list[Neighbourhood]:
        """The listed targets, with the frames of their sequence around them that have a usable pose, listed or not."""
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
        """In a collected dataset the floor of a scene, of which each episode and each viewpoint is a sequence."""
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
        """H x W float32 metres, 0 = none; None for a sequence without a folder of them."""
        file = self._optional(frame, "ground_truth")
        return None if file is None else read_depth(file, self.ground_truth_scale or self.scale)

    def pose(self, frame: FrameReference) -> np.ndarray | None:
        """4 x 4 float64; None for a sequence without a folder of them."""
        file = self._optional(frame, "absolute_pose")
        return None if file is None else read_pose(file)

    @cached_property
    def _is_collected(self) -> bool:
        """Recorded sequences such as seq-01 and seq-02 may show two scenes, whatever their names end with."""
        return (self.folder / MANIFEST).is_file()

    def _optional(self, frame: FrameReference, kind: str) -> Path | None:
        """The frame's file of a kind; None if its sequence has no folder of that kind."""
        file = self._paths(frame).file(kind, frame.name)
        return file if file.parent.is_dir() else None

    def _paths(self, frame: FrameReference) -> SequencePaths:
        return SequencePaths(self.folder / "data" / frame.sequence)

    def _listed_split(self, split: str) -> str:
        """The split whose lists hold the frames of this one."""
        return "train" if split == "validation" and self.validation else split

    def _divided(self, split: str, found: list[Triplet]) -> list[Triplet]:
        """Of the listed frames those of this split."""
        if self.validation and self._listed_split(split) == "train":
            return [one for one in found if (one.target.sequence in self.validation) == (split == "validation")]
        return found

    def _listed(self, split: str, offsets: tuple[int, ...]) -> list[Triplet]:
        """The triplets of a split that the dataset has lists of."""
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
        """Sequence and frame of an image's path; what comes before `data/` may differ from the dataset's folder now."""
        parts = line.rsplit("/", 4)[-4:]  # a Path would take most of the time in which a dataset is opened
        if len(parts) < 4 or parts[0] != "data":
            raise DeuxError(
                f"{self.folder} lists {line}, where a path like data/<sequence>/image/<frame>.png is expected."
            )
        if not all(map(is_file_name, (parts[1], parts[3]))):
            raise DeuxError(f"{self.folder} lists {line}, which can be the name of no file.")
        return FrameReference(parts[1], without_suffix(parts[3]))

    def _listed_triplets(self, lines: Sequence[str]) -> list[Triplet]:
        """The triplets of a list of ours; most images stand in three lines, and their frames are made once."""
        frame = cache(self._frame)
        triplets = []
        for line in lines:
            target, *sources = map(frame, line.split("\t"))
            triplets.append(Triplet(target, tuple(sources)))
        return triplets

    def _neighbours(self, split: str, lines: Sequence[str], offsets: tuple[int, ...]) -> list[Triplet]:
        """The listed targets with the frames at the offsets.

        A list vouches for its frames, so what is broken in them is an error where it is read. A frame that is in no
        list may have been left out for its pose: it serves as a source frame only if that can be read.
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
            _warn_once(
                f"{counted(len(broken), 'frame')} of {self.folder} that no {split} list names "
                f"{plural('has', len(broken))} no usable pose and {plural('is', len(broken))} no source "
                f"{plural('frame', len(broken))}: {next(iter(broken.values()))}"
            )
        usable = {target: others for target, others in sources.items() if not broken.keys() & others}
        return [Triplet(target, usable.get(target, ())) for target in targets]

    def _check_images(self, split: str, missing: set[FrameReference]) -> None:
        """Raise DeuxError if there are listed frames without an image."""
        if missing:
            first = min(missing)
            raise DeuxError(
                f"{self._paths(first).file('image', first.name)} is missing, which "
                f"{list_file(self.folder, split, 'image')} names"
                f"{f', and so are {len(missing) - 1} more' if len(missing) > 1 else ''}."
            )

    def _pose_problem(self, frame: FrameReference) -> str | None:
        """Why the frame's pose cannot be read; None if it can, or if its sequence has no poses."""
        try:
            self.pose(frame)
        except DeuxError as error:
            return str(error)
        return None


@lru_cache(maxsize=256)
def _warn_once(message: str) -> None:
    """Splits are listed several times in a run."""
    log.warning(message)


def _lines(path: Path) -> list[str]:
    """The lines of a list that are not blank, whichever way they end."""
    try:
        text = read_bytes(path).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise DeuxError(f"{path} is no list of frames: it is not a text file.") from error
    return [line.strip() for line in text.splitlines() if line.strip()]
