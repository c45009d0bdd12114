"""The reader `data=void`: the VOID release (Wong et al., RA-L 2020), indoor video with points of visual odometry."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Literal

import numpy as np

from deux.contracts import FrameReference, MissingSplit
from deux.errors import DeuxError, check_range, shown
from deux.io.atomic import read_bytes
from deux.io.calibration import read_intrinsics, read_pose
from deux.io.frame_files import IMAGE_SUFFIXES, list_files
from deux.io.layout import natural_order
from deux_plugins.readers.parts.recorded_video import (
    Clip,
    FrameFiles,
    Frames,
    RecordedVideo,
    check_video_options,
    held_out,
    report_skipped,
)

Density = Literal[150, 500, 1500]


@dataclass(frozen=True)
class Void(RecordedVideo):
    """Reads the unpacked release: void_release/ with void_150/, void_500/ and void_1500/, or one of the three.

        void_1500/
            data/<sequence>/{image,sparse_depth,ground_truth}/<time stamp>.png, absolute_pose/<time stamp>.txt, K.txt
            train_image.txt, test_image.txt

    The list files name the targets. Source frames may be any frames of the sequence, listed or not. The folder
    validity_map is not read: it is redundant with the pixels of sparse_depth that are above 0.

    Args:
        folder: void_release/, void_150/, void_500/ or void_1500/.
        points: the density to read, by its nominal number of points, if the folder has several.
        gap: distance of source frames in frames, multiplied by the offsets; with `training.offsets=[-1,1]` this is the
            published set-up.
        margin: number of frames at both ends of a sequence, where the camera does not move, that are not used as
            training targets.
        validation: number of training sequences, the last by name, that are held out for validation.
        scale: stored depth values per metre.

    Raises:
        DeuxError: the folder does not have this layout, or `points` does not select one of its densities.
    """

    folder: Path
    points: Density | None = None
    gap: int = 10
    margin: int = 30
    validation: int = 3
    scale: float = 256.0

    def __post_init__(self) -> None:
        check_video_options(self.gap, self.scale)
        check_range("data.margin", self.margin, 0)
        check_range("data.validation", self.validation, 0)
        _ = self._root

    @property
    def _root(self) -> Path:
        """The folder of the chosen density."""
        if (self.folder / "data").is_dir():
            if self.points is not None and self.folder.name.startswith("void_") and self.folder.name != self._name:
                raise DeuxError(
                    f"data.points is {self.points}, but the folder is {self.folder}: leave data.points out."
                )
            return self.folder
        there = [path.parent.name for path in sorted(self.folder.glob("void_*/data"))]
        if not there:
            raise DeuxError(
                f"{self.folder} is not the VOID release: void_150/, void_500/ and void_1500/, or data/, are expected."
            )
        name = there[0] if self.points is None and len(there) == 1 else self._name
        if name not in there:
            raise DeuxError(f"{self.folder} has {', '.join(there)}: choose one by data.points=150, 500 or 1500.")
        return self.folder / name

    @property
    def _name(self) -> str:
        return f"void_{self.points}"

    def intrinsics(self, frame: FrameReference) -> np.ndarray:
        """The sequence's K.txt, 3 x 3 float64."""
        return read_intrinsics(self._root / "data" / frame.sequence / "K.txt")

    def pose(self, frame: FrameReference) -> np.ndarray | None:
        """4 x 4 float64, camera-to-world; None if the sequence has no folder `absolute_pose/`."""
        folder = self._root / "data" / frame.sequence / "absolute_pose"
        return read_pose(folder / f"{frame.name}.txt") if folder.is_dir() else None

    def _find(self) -> Frames:
        found: Frames = {}
        for folder in sorted(path for path in (self._root / "data").iterdir() if path.is_dir()):
            kinds = {kind: list_files(folder / kind, (".png",)) for kind in ("sparse_depth", "ground_truth")}
            images = list_files(folder / "image", IMAGE_SUFFIXES)
            found[folder.name] = {
                name: FrameFiles(
                    image,
                    kinds["sparse_depth"].get(name),
                    # A missing file in an existing folder raises an error when it is read.
                    folder / "ground_truth" / f"{name}.png" if kinds["ground_truth"] else None,
                    self.scale,
                )
                for name, image in images.items()
            }
        return found

    def _clips(self, split: str) -> list[Clip]:
        name = "test" if split == "test" else "train"
        if name not in self._listed:
            raise MissingSplit(f"{self._root} has no {name}_image.txt, which would list the {split} frames.")
        listed = self._listed[name]
        if split != "test":
            training, validation = held_out(
                sorted(listed, key=natural_order), self.validation, "sequences", self.folder
            )
            listed = {sequence: listed[sequence] for sequence in (training if split == "train" else validation)}
        clips = []
        for sequence, targets in listed.items():
            frames = list(self._frames[sequence])
            if split == "train":
                inside = set(frames[self.margin : len(frames) - self.margin])
                targets = [target for target in targets if target in inside]
            clips.append(Clip(sequence, targets, frames, self.gap))
        return clips

    def _expected(self, split: str) -> str:
        if split == "validation" and self.validation == 0:
            return "set data.validation=3 to hold out three training sequences."
        return f"data.gap={self.gap} and data.margin={self.margin} leave none of the listed frames."

    @cached_property
    def _listed(self) -> dict[str, dict[str, list[str]]]:
        """The listed frames of each split by sequence, in the order of time."""
        found: dict[str, dict[str, list[str]]] = {}
        for split in ("train", "test"):
            path = self._root / f"{split}_image.txt"
            if not path.exists():
                continue
            wanted = set(_read_list(path))
            found[split] = {}
            for sequence in sorted({sequence for sequence, _ in wanted}):
                there = self._frames.get(sequence, {})
                names = [n for n, f in there.items() if f.sparse_depth is not None and (sequence, n) in wanted]
                if names:
                    found[split][sequence] = names
            usable = sum(map(len, found[split].values()))
            report_skipped(path, usable, {"without image or sparse depth": len(wanted) - usable})
        return found


def _read_list(path: Path) -> Iterator[tuple[str, str]]:
    """Sequence and frame of each listed image; the folders before data/ are ignored."""
    for line in read_bytes(path).decode(errors="replace").splitlines():
        parts = Path(line.strip()).parts
        if not parts:
            continue
        if len(parts) < 4 or parts[-4] != "data":
            raise DeuxError(
                f"{path} has the line {shown(line)}: void_1500/data/<sequence>/image/<time stamp>.png is expected."
            )
        yield parts[-3], Path(parts[-1]).stem
