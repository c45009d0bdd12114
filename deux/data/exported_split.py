"""The frames of each exported split, with unique names, and the writer of their files."""

import logging
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from deux.contracts import FrameReference, Reader, Triplet
from deux.data.checked_frames import ground_truth_of, image_of, pose_of, sparse_depth_of
from deux.data.chosen_sources import list_triplets
from deux.data.frame_sizes import check_one_size
from deux.errors import DeuxError
from deux.io.atomic import make_folder
from deux.io.calibration import write_matrix
from deux.io.file_names import check_frame_path
from deux.io.images import write_depth, write_image
from deux.io.layout import SourceChoice

SOURCES = 2
"""Source frames of a triplet, as the published training code expects."""

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class ExportedSplit:
    """The frames of one split.

    Args:
        name: "train", "validation" or "test".
        reader: the reader of the frames' folder.
        triplets: the targets with their source frames.
        suffix: is appended to the names of its sequences, which must differ from those of the other splits.

    Raises:
        DeuxError: the files of a frame would lie outside of the exported folder.
    """

    name: str
    reader: Reader
    triplets: tuple[Triplet, ...]
    suffix: str = ""

    def __post_init__(self) -> None:
        for target, _ in self.triplets:
            check_frame_path(target.sequence, target.name, f"the export of {self.reader.folder}")

    def sequence(self, frame: FrameReference) -> str:
        """The name of a frame's sequence in the export."""
        return frame.sequence + self.suffix

    def sequences(self) -> dict[str, list[Triplet]]:
        """The triplets of each sequence, by its name in the export, in the order of the split."""
        found: dict[str, list[Triplet]] = {}
        for triplet in self.triplets:
            found.setdefault(self.sequence(triplet.target), []).append(triplet)
        return found


def complete_lists(split: ExportedSplit, lines: Mapping[str, list[str]]) -> dict[str, list[str]]:
    """Keep the list files that have a line for every target, because scripts read the lists in parallel.

    A list file that lacks only some targets is left out with a warning.

    Args:
        split: the split whose targets are listed.
        lines: the lines of each list file, by the kind of file that it lists.
    """
    count = len(split.triplets)
    for kind, named in lines.items():
        if 0 < len(named) < count:
            log.warning(
                "%s_%s.txt is not written: %d of the %d targets have no %s, and the lists are read line by line",
                *(split.name, kind, count - len(named), count, kind),
            )
    return {kind: named for kind, named in lines.items() if len(named) == count}


def read_splits(
    readers: dict[str, Reader], offsets: tuple[int, ...], choice: SourceChoice = "recent"
) -> list[ExportedSplit]:
    """List the targets of each split; in training and validation splits only those with two source frames.

    Args:
        readers: the reader of each exported split, by the split's name.
        offsets: the recent source frames, as offsets from the target; unused if a folder lists them.
        choice: how the source frames of training and validation splits are chosen.

    Raises:
        DeuxError: a split has no frames, or no targets with two source frames.
    """
    splits: list[ExportedSplit] = []
    taken: set[str] = set()
    for name in (name for name in ("train", "validation", "test") if name in readers):
        listed = list_triplets(readers[name], name, "recent" if name == "test" else choice, offsets)
        triplets = tuple(t for t in listed if name == "test" or len(t.sources) == SOURCES)
        if not triplets:
            raise DeuxError(
                f"no frame of the {name} split of {readers[name].folder} has {SOURCES} source frames at the offsets "
                f"{list(offsets)}: what is exported for training needs them (training.offsets)."
            )
        own = {triplet.target.sequence for triplet in triplets}
        # If two splits shared a sequence, the published set-up code would train on test frames.
        splits.append(ExportedSplit(name, readers[name], triplets, f"-{name}" if own & taken else ""))
        taken |= {splits[-1].sequence(triplet.target) for triplet in triplets}
    return splits


class TargetArrays(NamedTuple):
    """The exported arrays of a target, all of one size.

    Args:
        images: H x W x 3 uint8, the target's image, then those of its source frames.
        sparse_depth: H x W float32 metres, 0 = none.
        ground_truth: H x W float32 metres, 0 = none; None if there is none.
    """

    images: list[np.ndarray]
    sparse_depth: np.ndarray
    ground_truth: np.ndarray | None


def read_target(reader: Reader, triplet: Triplet) -> TargetArrays:
    """Read the exported arrays of a target.

    Raises:
        DeuxError: a file is damaged, or an array has another size than the target's image.
    """
    target, sources = triplet
    images = [image_of(reader, frame) for frame in (target, *sources)]
    arrays = TargetArrays(images, sparse_depth_of(reader, target), ground_truth_of(reader, target))
    named = [(f"source frame {frame.name}", image) for frame, image in zip(sources, images[1:], strict=True)]
    named += [("sparse depth", arrays.sparse_depth)]
    named += [] if arrays.ground_truth is None else [("ground truth", arrays.ground_truth)]
    check_one_size(reader, target, images[0].shape[:2], ((name, array.shape[:2]) for name, array in named))
    return arrays


class FrameExport:
    """Writes the frames of a reader in the file formats of the VOID release.

    Args:
        folder: contains a folder for each kind of file; created if missing.
        reader: the reader of the frames.
    """

    def __init__(self, folder: Path, reader: Reader) -> None:
        self.folder = folder
        self.reader = reader

    def write_image(self, image: np.ndarray, name: str) -> None:
        """Write an image, H x W x 3 uint8, as PNG."""
        write_image(self._file("image", f"{name}.png"), image)

    def write_sparse(self, sparse_depth: np.ndarray, name: str) -> None:
        """Write H x W metres as 16-bit PNG (metres x 256), and the validity map as 16-bit PNG (256 = valid)."""
        write_depth(self._file("sparse_depth", f"{name}.png"), sparse_depth)
        write_depth(self._file("validity_map", f"{name}.png"), (sparse_depth > 0).astype(np.float32))

    def write_ground_truth(self, truth: np.ndarray | None, name: str) -> None:
        """Write H x W metres as 16-bit PNG; None writes nothing."""
        if truth is not None:
            write_depth(self._file("ground_truth", f"{name}.png"), truth)

    def write_pose(self, frame: FrameReference, name: str) -> bool:
        """Write the camera-to-world pose as 3 x 4 numbers; returns whether the frame has a pose."""
        pose = pose_of(self.reader, frame)
        if pose is not None:
            write_matrix(self._file("absolute_pose", f"{name}.txt"), pose[:3])
        return pose is not None

    def _file(self, kind: str, name: str) -> Path:
        make_folder(self.folder / kind)
        return self.folder / kind / name
