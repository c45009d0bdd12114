"""The folder layout of datasets, which extends that of the VOID release.

    <dataset>/
        data/<sequence>/
            image/ sparse_depth/ validity_map/ ground_truth/   NNNNNN.png
            absolute_pose/                                     NNNNNN.txt, camera-to-world
            K.txt
        <split>_{image,sparse_depth,validity_map,ground_truth,absolute_pose,intrinsics}.txt
        <split>_triplets.txt, <split>_triplets_baseline.txt, manifest.json

The six list files of a split have one line per target frame, all in the same order. As in the release, a line starts
with the name of the dataset's folder, `<dataset>/data/<sequence>/image/000002.png`. The triplet lists and the manifest
are not part of the release, and optional for reading. The first triplet list has the targets of the other lists with
their source frames t-1 and t-2; the second has the targets that can be used for training with source frames chosen by
`deux.geometry.source_frames`.

Collected sequences also contain `episode.json` (floor, seed, start, actions), `verification.json` and optionally
`uncertainty.csv` (delta of Eq. 8 at each pose), the explorer's final `map.npz` and a folder `labels/`. Each episode,
and the first free viewpoint of each floor, contains the free space of the robot in `free_floor.npz`.

A recorded dataset may have JPEG images (`STORED_IMAGE_SUFFIXES`). `validity_map/` is written but not read: as in the
release, a sparse point is valid if its depth is above 0.
"""

import os
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

SUFFIXES = {
    "image": ".png",
    "sparse_depth": ".png",
    "validity_map": ".png",
    "ground_truth": ".png",
    "absolute_pose": ".txt",
    "labels": ".png",
}
"""Suffix of each kind of file of a frame."""

STORED_IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg", ".PNG", ".JPG", ".JPEG")
"""Suffixes of recorded images, in the order of precedence."""

MANIFEST = "manifest.json"
"""The description of a collected dataset; recorded datasets have none."""

PUBLISHED_KINDS = ("image", "sparse_depth", "validity_map", "ground_truth", "absolute_pose")
"""The kinds of files of a frame in the VOID release."""

SourceChoice = Literal["baseline", "recent"]
"""How source frames are chosen: by parallax and overlap, or at fixed offsets in time (t-1 and t-2 in the paper)."""

TRIPLET_LISTS: dict[SourceChoice, str] = {"recent": "triplets", "baseline": "triplets_baseline"}
"""The kind of the triplet list for each choice of source frames, see `list_file`."""


@dataclass(frozen=True)
class SequencePaths:
    """The paths of the files of one sequence.

    Args:
        folder: the sequence's folder, `<dataset>/data/<sequence>`.
    """

    folder: Path

    @property
    def name(self) -> str:
        """The sequence's name."""
        return self.folder.name

    @property
    def intrinsics(self) -> Path:
        """K.txt, the sequence's camera matrix."""
        return self.folder / "K.txt"

    def file(self, kind: str, frame: str) -> Path:
        """The path of a frame's file of one kind (a key of `SUFFIXES`)."""
        return self.folder / kind / f"{frame}{SUFFIXES[kind]}"

    def recorded_image(self, frame: str) -> Path:
        """The path of a frame's image with any of `STORED_IMAGE_SUFFIXES`; that of a PNG file if there is none."""
        found = (self.folder / "image" / f"{frame}{suffix}" for suffix in STORED_IMAGE_SUFFIXES)
        return next((path for path in found if path.exists()), self.file("image", frame))

    def frames(self) -> list[str]:
        """Names of the frames that have an image, in the order of time."""
        names = {without_suffix(name) for name in self._listing("image") if name.endswith(STORED_IMAGE_SUFFIXES)}
        if all(map(str.isdecimal, names)) and len(set(map(len, names))) == 1:
            return sorted(names)  # for numbers of equal length the same order, and many times faster
        return sorted(names, key=natural_order)

    def names(self, kind: str) -> set[str]:
        """Names of the frames that have a file of one kind (a key of `SUFFIXES`)."""
        suffix = SUFFIXES[kind]
        return {name.removesuffix(suffix) for name in self._listing(kind) if name.endswith(suffix)}

    def _listing(self, kind: str) -> list[str]:
        """The file names of one kind; empty if its folder does not exist."""
        try:
            names = os.listdir(self.folder / kind)
        except (FileNotFoundError, NotADirectoryError):
            return []
        return [name for name in names if name[0] != "."]  # temporary files of a killed run begin with a dot


def without_suffix(image: str) -> str:
    """The name of a frame, given the file name of its image."""
    stem, dot, suffix = image.rpartition(".")
    return stem if f"{dot}{suffix}" in STORED_IMAGE_SUFFIXES else image


def natural_order(name: str) -> tuple[tuple[str, int, str], ...]:
    """Sort key that orders numbers within names by their value, such as time stamps and frame numbers.

    Example:
        >>> sorted(["frame_10", "frame_2", "9.75", "10.5", "10.25"], key=natural_order)
        ['9.75', '10.25', '10.5', 'frame_2', 'frame_10']
    """
    parts = re.findall(r"([^0-9]*)(?:([0-9]+)(?:\.([0-9]+))?)?", name)
    # Digits after a decimal point are sorted as text: 10.25 comes before 10.5.
    return *((text, int(whole or -1), fraction) for text, whole, fraction in parts), (name, 0, "")


def frame_name(index: int) -> str:
    """Name of a collected frame, six digits."""
    return f"{index:06d}"


def sequences(dataset: Path) -> list[SequencePaths]:
    """All sequences of a dataset, sorted by name."""
    with os.scandir(dataset / "data") as entries:  # avoids a system call for each entry
        names = sorted(entry.name for entry in entries if entry.is_dir())
    return [SequencePaths(dataset / "data" / name) for name in names]


def neighbours(frames: Sequence[str], offsets: tuple[int, ...]) -> list[tuple[str, ...]]:
    """The frames of a sequence whose source frames all exist, each followed by its source frames.

    Args:
        frames: the names of the frames in the order of time.
        offsets: the source frames, as offsets from the target in frames.
    """
    first, last = max(0, -min(offsets)), len(frames) - max(0, *offsets)
    return [(frames[i], *(frames[i + offset] for offset in offsets)) for i in range(first, last)]


def list_file(dataset: Path, split: str, kind: str) -> Path:
    """The path of a list file of a split; `kind` is "intrinsics" or one of `PUBLISHED_KINDS` or `TRIPLET_LISTS`."""
    return dataset / f"{split}_{kind}.txt"
