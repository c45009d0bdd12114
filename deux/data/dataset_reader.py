"""`data=deux`: the datasets that deux collects, and the VOID release, whose layout they have."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from deux.contracts import FrameReference, Reader, Triplet
from deux.errors import DeuxError
from deux.io.atomic import read_bytes
from deux.io.calibration import read_intrinsics, read_pose
from deux.io.images import read_depth, read_image
from deux.io.layout import SequencePaths, list_file, neighbours


@dataclass(frozen=True)
class DatasetReader(Reader):
    """Reads the layout of the VOID release, with or without the triplet list that deux adds (`deux.io.layout`).

    Args:
        folder: the dataset.

    Raises:
        DeuxError: the folder has no sequences in this layout.
    """

    folder: Path

    def __post_init__(self) -> None:
        if not (self.folder / "data").is_dir():
            raise DeuxError(f"{self.folder} is no dataset: it has no folder data/ with sequences in VOID's layout.")

    def triplets(self, split: str, offsets: tuple[int, ...]) -> list[Triplet]:
        """Our own datasets list them. Elsewhere, as in the VOID release, the split's image list names the targets.

        The source frames are then those at the offsets in the sequence; targets at its ends that lack one are left out.
        """
        listed = list_file(self.folder, split, "triplets")
        if listed.exists():
            found = [self._listed_triplet(line) for line in _lines(listed)]
        elif list_file(self.folder, split, "image").exists():
            found = self._neighbours(_lines(list_file(self.folder, split, "image")), offsets)
        else:
            there = sorted({path.name.rsplit("_image.txt")[0] for path in self.folder.glob("*_image.txt")})
            raise DeuxError(
                f"{self.folder} has no {split} split, whose frames {split}_image.txt would list; it has "
                f"{', '.join(there) or 'no list files at all'}."
            )
        if not found:
            raise DeuxError(f"The {split} split of {self.folder} has no frames.")
        return found

    def image(self, frame: FrameReference) -> np.ndarray:
        """H x W x 3 uint8."""
        return read_image(self._paths(frame).file("image", frame.name))

    def intrinsics(self, frame: FrameReference) -> np.ndarray:
        """The sequence's K.txt, 3 x 3 float64."""
        return read_intrinsics(self._paths(frame).intrinsics)

    def sparse_depth(self, frame: FrameReference) -> np.ndarray:
        """H x W float32 metres, 0 = none."""
        return read_depth(self._paths(frame).file("sparse_depth", frame.name))

    def ground_truth(self, frame: FrameReference) -> np.ndarray | None:
        """H x W float32 metres, 0 = none; None for a sequence without a folder of them."""
        file = self._optional(frame, "ground_truth")
        return None if file is None else read_depth(file)

    def pose(self, frame: FrameReference) -> np.ndarray | None:
        """4 x 4 float64; None for a sequence without a folder of them."""
        file = self._optional(frame, "absolute_pose")
        return None if file is None else read_pose(file)

    def _optional(self, frame: FrameReference, kind: str) -> Path | None:
        """The frame's file of a kind; None if its sequence has no folder of that kind."""
        file = self._paths(frame).file(kind, frame.name)
        return file if file.parent.is_dir() else None

    def _paths(self, frame: FrameReference) -> SequencePaths:
        return SequencePaths(self.folder / "data" / frame.sequence)

    def _frame(self, line: str) -> FrameReference:
        """Sequence and frame of an image's path; what comes before `data/` may differ from the dataset's folder now."""
        parts = Path(line).parts
        if len(parts) < 4 or parts[-4] != "data":
            raise DeuxError(
                f"{self.folder} lists {line}, where a path like data/<sequence>/image/<frame>.png is expected."
            )
        return FrameReference(parts[-3], parts[-1].removesuffix(".png"))

    def _listed_triplet(self, line: str) -> Triplet:
        target, *sources = (self._frame(image) for image in line.split("\t"))
        return Triplet(target, tuple(sources))

    def _neighbours(self, lines: Sequence[str], offsets: tuple[int, ...]) -> list[Triplet]:
        sources: dict[str, dict[str, tuple[str, ...]]] = {}
        found = []
        for line in lines:
            target = self._frame(line)
            if target.sequence not in sources:
                names = neighbours(self._paths(target).frames(), offsets)
                sources[target.sequence] = {name: others for name, *others in names}  # type: ignore[misc]
            if target.name in sources[target.sequence]:
                others = sources[target.sequence][target.name]
                found.append(Triplet(target, tuple(FrameReference(target.sequence, name) for name in others)))
        return found


def _lines(path: Path) -> list[str]:
    try:
        return read_bytes(path).decode().splitlines()
    except UnicodeDecodeError as error:
        raise DeuxError(f"{path} is no list of frames: it is not a text file.") from error
