"""The reader `data=triplets`: datasets in the format of the training scripts of the KBNet family."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from deux.contracts import FrameReference, MissingSplit, Reader, Triplet
from deux.data.triplet_export import INTRINSICS, LISTED, own_intrinsics, source_name
from deux.errors import DeuxError, shown
from deux.io.atomic import read_bytes
from deux.io.calibration import read_pose
from deux.io.camera_files import read_any_intrinsics
from deux.io.file_names import is_file_name
from deux.io.images import read_depth, read_image
from deux.io.layout import SUFFIXES, list_file

SIDE = {1: 0, 0: 1, 2: 2}
"""The third of a triplet image that contains the target (0) and its source frames (1 and 2)."""


@dataclass(frozen=True)
class TripletImages(Reader):
    """Reads datasets written by `task=export_dataset export_dataset.format=triplets` or the published set-up scripts.

    An image contains three frames side by side: a source frame, the target and the other source frame. The list of a
    split's images names the targets; the folder before `data/` in its paths may differ from the present folder.

    Args:
        folder: the folder that contains `data/` and the list files.

    Raises:
        DeuxError: the folder has no `data/`.
    """

    folder: Path

    def __post_init__(self) -> None:
        if not (self.folder / "data").is_dir():
            raise DeuxError(f"{self.folder} is not a dataset of triplets: a folder data/ with sequences is expected.")

    def triplets(self, split: str, offsets: tuple[int, ...]) -> list[Triplet]:
        """The targets that `<split>_image.txt` lists, each with two source frames."""
        listed = list_file(self.folder, split, "image")
        if not listed.is_file():
            raise MissingSplit(f"{self.folder} has no {split} split, whose images {listed.name} would list.")
        found = [self._triplet(line, listed) for line in read_bytes(listed).decode(errors="replace").splitlines()]
        if not found:
            raise MissingSplit(f"the {split} split of {self.folder} has no frames: {listed.name} is empty.")
        return found

    def image(self, frame: FrameReference) -> np.ndarray:
        """The frame's third of its triplet image, H x W x 3 uint8."""
        target, number = self._target(frame)
        path = self._file(frame.sequence, "image", target)
        image = read_image(path)
        if image.shape[1] % 3:
            raise DeuxError(f"{path} is not a triplet: it is {image.shape[1]} pixels wide, not a multiple of 3.")
        width = image.shape[1] // 3
        first = SIDE[number] * width
        return image[:, first : first + width].copy()

    def intrinsics(self, frame: FrameReference) -> np.ndarray:
        """3 x 3 float64: the frame's own file if there is one, else that of its target or of the sequence."""
        sequence = self.folder / "data" / frame.sequence
        names = (own_intrinsics(frame.name), own_intrinsics(self._target(frame)[0]))
        own = (sequence / name for name in names if (sequence / name).is_file())
        return read_any_intrinsics(next(own, sequence / INTRINSICS))

    def sparse_depth(self, frame: FrameReference) -> np.ndarray:
        """H x W float32 metres, 0 = none; only for targets."""
        return read_depth(self._of_target(frame, "sparse_depth"))

    def ground_truth(self, frame: FrameReference) -> np.ndarray | None:
        """H x W float32 metres, 0 = none; only for targets. None if the sequence has no folder `ground_truth/`."""
        path = self._of_target(frame, "ground_truth")
        return read_depth(path) if path.parent.is_dir() else None

    def pose(self, frame: FrameReference) -> np.ndarray | None:
        """4 x 4 float64; None if the sequence has no folder `absolute_pose/`."""
        path = self._file(frame.sequence, "absolute_pose", frame.name)
        return read_pose(path) if path.parent.is_dir() else None

    def _of_target(self, frame: FrameReference, kind: str) -> Path:
        target, number = self._target(frame)
        if number:
            raise DeuxError(f"{self.folder} has no {kind} of source frames, such as that of {target}.")
        return self._file(frame.sequence, kind, target)

    def _target(self, frame: FrameReference) -> tuple[str, int]:
        """The name of the frame's target, and the number of the source frame, 0 for the target itself."""
        target, dash, number = frame.name.rpartition("-")
        if dash and number in ("1", "2") and not self._file(frame.sequence, "image", frame.name).is_file():
            return target, int(number)
        return frame.name, 0

    def _file(self, sequence: str, kind: str, name: str) -> Path:
        return self.folder / "data" / sequence / kind / f"{name}{SUFFIXES[kind]}"

    def _triplet(self, line: str, listed: Path) -> Triplet:
        parts = Path(line).parts
        if len(parts) < 4 or parts[-2] != LISTED[0] or not (is_file_name(parts[-3]) and is_file_name(parts[-1])):
            raise DeuxError(
                f"{listed} lists {shown(line)}, where a path like data/<sequence>/image/<frame>.png is expected."
            )
        name = Path(line).stem
        sources = (FrameReference(parts[-3], source_name(name, number)) for number in (1, 2))
        return Triplet(FrameReference(parts[-3], name), tuple(sources))
