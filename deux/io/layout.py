"""The folder layout of the VOID release, in which every dataset is written and read.

    <dataset>/
        data/<sequence>/
            image/ sparse_depth/ validity_map/ ground_truth/   NNNNNN.png
            absolute_pose/                                     NNNNNN.txt, camera-to-world
            K.txt
        <split>_{image,sparse_depth,validity_map,ground_truth,absolute_pose,intrinsics}.txt
        <split>_triplets.txt, <split>_triplets_baseline.txt, manifest.json

The six list files of a split have one line per target frame, all in the same order. As in the release, a line starts
with the dataset's own folder name, `<dataset>/data/<sequence>/image/000002.png`. The triplet lists and the manifest
are not part of the release; a dataset without them is read all the same. The first triplet list has the targets of the
six with their source frames t-1 and t-2; the second has those that can be trained on with the source frames that
`deux.geometry.source_frames` chooses.

Collected sequences also hold `episode.json` (floor, seed, start, actions), `verification.json` and, where there are
any, `uncertainty.csv` (delta of Eq. 8 at each pose), the explorer's final `map.npz` and a folder `labels/`. Where the
robot's centre could be is in `free_floor.npz` of each episode, and of the first viewpoint of a floor.

A recorded dataset may have JPEG images (`STORED_IMAGE_SUFFIXES`). `validity_map/` is written and not read: a sparse
point is valid where its depth is above 0, which is what the maps of the release say.
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
"""File suffix of each kind of file that a frame may have."""

STORED_IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg", ".PNG", ".JPG", ".JPEG")
"""File suffixes that a recorded image may have, the first that there is."""

MANIFEST = "manifest.json"
"""What a collected dataset is made of; a recorded one has none."""

PUBLISHED_KINDS = ("image", "sparse_depth", "validity_map", "ground_truth", "absolute_pose")
"""The kinds that the release has for each frame."""

SourceChoice = Literal["baseline", "recent"]
"""How source frames are chosen: by parallax and overlap, or at fixed distances in time (t-1 and t-2 in the paper)."""

TRIPLET_LISTS: dict[SourceChoice, str] = {"recent": "triplets", "baseline": "triplets_baseline"}
"""The triplet list of each way to choose source frames, as `list_file` takes it."""


@dataclass(frozen=True)
class SequencePaths:
    """Where the files of one sequence lie.

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
        """The file of one kind (a key of `SUFFIXES`) of the frame with the given name."""
        return self.folder / kind / f"{frame}{SUFFIXES[kind]}"

    def recorded_image(self, frame: str) -> Path:
        """The frame's image, whichever of `STORED_IMAGE_SUFFIXES` it has; the path of a PNG file if there is none."""
        found = (self.folder / "image" / f"{frame}{suffix}" for suffix in STORED_IMAGE_SUFFIXES)
        return next((path for path in found if path.exists()), self.file("image", frame))

    def frames(self) -> list[str]:
        """Names of the frames that have an image, in the order of time."""
        names = {without_suffix(name) for name in self._listing("image") if name.endswith(STORED_IMAGE_SUFFIXES)}
        if all(map(str.isdecimal, names)) and len(set(map(len, names))) == 1:  # as collected frames are named
            return sorted(names)  # of equal length, they sort as text as by their value, and many times faster
        return sorted(names, key=natural_order)

    def names(self, kind: str) -> set[str]:
        """Names of the frames that have a file of one kind (a key of `SUFFIXES`), by one look into its folder."""
        suffix = SUFFIXES[kind]
        return {name.removesuffix(suffix) for name in self._listing(kind) if name.endswith(suffix)}

    def _listing(self, kind: str) -> list[str]:
        """The files of one kind; none where there is no folder of that kind."""
        try:
            names = os.listdir(self.folder / kind)
        except (FileNotFoundError, NotADirectoryError):
            return []
        return [name for name in names if name[0] != "."]  # unfinished ones of a run that was killed begin with a dot


def without_suffix(image: str) -> str:
    """The name of the frame whose image has this file name."""
    stem, dot, suffix = image.rpartition(".")
    return stem if f"{dot}{suffix}" in STORED_IMAGE_SUFFIXES else image


def natural_order(name: str) -> tuple[tuple[str, int, str], ...]:
    """Sort key under which numbers within names count by their value, as time stamps and frame numbers do.

    Example:
        >>> sorted(["frame_10", "frame_2", "9.75", "10.5", "10.25"], key=natural_order)
        ['9.75', '10.25', '10.5', 'frame_2', 'frame_10']
    """
    parts = re.findall(r"([^0-9]*)(?:([0-9]+)(?:\.([0-9]+))?)?", name)
    # Digits after a decimal point sort as text: 10.25 comes before 10.5.
    return *((text, int(whole or -1), fraction) for text, whole, fraction in parts), (name, 0, "")


def frame_name(index: int) -> str:
    """Name of a collected frame, six digits."""
    return f"{index:06d}"


def sequences(dataset: Path) -> list[SequencePaths]:
    """All sequences of a dataset, by name."""
    with os.scandir(dataset / "data") as entries:  # tells folders from files without a look at each
        names = sorted(entry.name for entry in entries if entry.is_dir())
    return [SequencePaths(dataset / "data" / name) for name in names]


def neighbours(frames: Sequence[str], offsets: tuple[int, ...]) -> list[tuple[str, ...]]:
    """The frames of a sequence that have all their source frames, each followed by these.

    Args:
        frames: in the order of time.
        offsets: the source frames, in frames from the target.
    """
    first, last = max(0, -min(offsets)), len(frames) - max(0, *offsets)
    return [(frames[i], *(frames[i + offset] for offset in offsets)) for i in range(first, last)]


def list_file(dataset: Path, split: str, kind: str) -> Path:
    """The list file of one kind ("intrinsics" or one of `PUBLISHED_KINDS` or `TRIPLET_LISTS`) of a split."""
    return dataset / f"{split}_{kind}.txt"
