"""The reader `data=kitti`: KITTI depth completion (Uhrig et al., 3DV 2017), driving video with lidar points."""

import os
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Literal

import numpy as np

from deux.contracts import FrameReference, MissingSplit
from deux.errors import DeuxError, check_range, shown
from deux.io.atomic import read_bytes
from deux.io.calibration import checked_intrinsics, read_intrinsics
from deux.io.frame_files import IMAGE_SUFFIXES, list_files
from deux_plugins.readers.parts.recorded_video import (
    Clip,
    FrameFiles,
    Frames,
    RecordedVideo,
    check_video_options,
    held_out,
    report_skipped,
)

Selection = Literal["val_selection_cropped", "test_depth_completion_anonymous"]

_ROOTS = {
    "groundtruth": ("data_depth_annotated", "train_val_split/ground_truth", "."),
    "velodyne_raw": ("data_depth_velodyne", "train_val_split/sparse_depth", "."),
}
"""The folders that contain train/ and val/ of each kind of depth: as unpacked, or in other common layouts."""

_RAW = ("kitti_raw", "kitti_raw_data", "raw_data", "raw", ".")
_SELECTIONS = ("depth_selection", "data_depth_selection/depth_selection", "data_depth_selection", ".")
_FORWARD, _LEFTWARD = 8, 9  # columns of an oxts file: velocities in m/s


@dataclass(frozen=True)
class Kitti(RecordedVideo):
    """Reads the depth maps of the benchmark together with the images and calibrations of the raw recordings.

        data_depth_velodyne/{train,val}/<drive>_sync/proj_depth/velodyne_raw/image_02/<frame>.png
        data_depth_annotated/{train,val}/<drive>_sync/proj_depth/groundtruth/image_02/<frame>.png
        kitti_raw/<date>/<drive>_sync/image_02/data/<frame>.png (or .jpg), <date>/calib_cam_to_cam.txt
        depth_selection/val_selection_cropped/{image,velodyne_raw,groundtruth_depth,intrinsics}/

    Splits: the drives in train/ for training, the drives in val/ for validation, and the selected single frames for
    test. The selection is taken from the drives in val/, so that model selection by these uses test images; to avoid
    this, `validation` holds out training drives instead. Each camera of a drive is a sequence. There are no poses, so
    models are trained with pose=learned.

    Args:
        folder: the folder that contains these folders.
        raw: the folder of the raw recordings, kitti_raw/ above, if it is elsewhere.
        cameras: the colour cameras to read: 2 is the left one, 3 the right one.
        gap: distance of source frames in frames, multiplied by the offsets.
        validation: number of training drives, the last by name, that are held out for validation; 0 to use val/.
        test: the selection to use as the test split; only val_selection_cropped has ground truth.
        static_frames: a text file with a line "date drive frame" for each frame in which the car does not move, as in
            the published list. These frames are not used as training targets.
        min_speed: without such a list, frames with less than this speed in metres per second are not used as training
            targets, if the drive has an oxts folder.
        scale: stored depth values per metre.

    Raises:
        DeuxError: the folder has neither drives nor the selection, or an option is out of range.
    """

    folder: Path
    raw: Path | None = None
    cameras: tuple[int, ...] = (2, 3)
    gap: int = 1
    validation: int = 0
    test: Selection = "val_selection_cropped"
    static_frames: Path | None = None
    min_speed: float = 0.5
    scale: float = 256.0

    def __post_init__(self) -> None:
        check_video_options(self.gap, self.scale)
        check_range("data.validation", self.validation, 0)
        check_range("data.min_speed", self.min_speed, 0)
        if not self.cameras or not set(self.cameras) <= {2, 3}:
            raise DeuxError(f"data.cameras is {list(self.cameras)}: it must be [2], [3] or [2,3] (colour cameras).")
        if self._depth_root("velodyne_raw") is None and self._selection is None:
            raise DeuxError(
                f"{self.folder} has no depth maps of KITTI: data_depth_velodyne/train/<drive>_sync/proj_depth/"
                f"velodyne_raw/ or depth_selection/{self.test}/ is expected."
            )

    def intrinsics(self, frame: FrameReference) -> np.ndarray:
        """3 x 3 float64: P_rect_02 or P_rect_03 of the date's calibration, or the file of a single frame."""
        image = self._files(frame).image
        if frame.sequence == self.test:
            return read_intrinsics(image.parent.parent / "intrinsics" / f"{image.stem}.txt")
        drive, camera = _parts(frame.sequence)
        return _rectified(self._raw_root / drive[:10] / "calib_cam_to_cam.txt", camera)

    def place(self, frame: FrameReference) -> str:
        """The drive, which both of its cameras show; for single frames it is part of the file name."""
        name = frame.name if frame.sequence == self.test else frame.sequence
        drive, found, _ = name.partition("_image_")
        return drive if found else frame.sequence

    def _find(self) -> Frames:
        found: Frames = {}
        usable = missing = 0
        for drive, split in self._drives.items():
            for number in self.cameras:
                camera = f"image_{number:02d}"
                images = list_files(self._raw_root / drive[:10] / drive / camera / "data", IMAGE_SUFFIXES)
                depth = {
                    kind: list_files(root / split / drive / "proj_depth" / kind / camera, (".png",))
                    for kind in _ROOTS
                    if (root := self._depth_root(kind)) is not None
                }
                sparse, truth = depth["velodyne_raw"], depth.get("groundtruth", {})
                usable += len(sparse.keys() & images.keys())
                missing += len(sparse.keys() - images.keys())
                if images:
                    found[f"{drive}_{camera}"] = {
                        name: FrameFiles(image, sparse.get(name), truth.get(name), self.scale)
                        for name, image in images.items()
                    }
        if self._drives:
            report_skipped(self.folder, usable, {"without raw image": missing})
        if self._selection is not None:
            found[self.test] = self._selected(self._selection)
        return found

    def _selected(self, folder: Path) -> dict[str, FrameFiles]:
        """The single frames of a selection."""
        images, points = (list_files(folder / kind, (".png",)) for kind in ("image", "velodyne_raw"))
        truths = list_files(folder / "groundtruth_depth", (".png",))
        found = {}
        for name, image in images.items():
            sparse = points.get(name.replace("_sync_image_", "_sync_velodyne_raw_"))
            truth = truths.get(name.replace("_sync_image_", "_sync_groundtruth_depth_"))
            found[name] = FrameFiles(image, sparse, truth, self.scale)
        usable = sum(files.has_depth for files in found.values())
        report_skipped(folder, usable, {"without sparse depth": len(found) - usable})
        return found

    def _clips(self, split: str) -> list[Clip]:
        if split == "test":
            selected = self._frames.get(self.test, {})
            return [Clip(self.test, [name for name, files in selected.items() if files.has_depth])]
        training = [drive for drive, folder in self._drives.items() if folder == "train"]
        drives = [drive for drive, folder in self._drives.items() if folder == "val"]
        if self.validation:
            training, drives = held_out(training, self.validation, "drives", self.folder)
        chosen = set(training if split == "train" else drives)
        excluded = self._static if split == "train" else frozenset()
        clips, total = [], 0
        for sequence, frames in self._frames.items():
            if sequence != self.test and _parts(sequence)[0] in chosen:
                targets = [name for name, files in frames.items() if files.sparse_depth is not None]
                total += len(targets)
                targets = [name for name in targets if (sequence, name) not in excluded]
                clips.append(Clip(sequence, targets, list(frames), self.gap))
        usable = sum(len(clip.targets) for clip in clips)
        report_skipped(f"{self.folder}, {split}", usable, {"static": total - usable})
        if total > usable == 0:
            static = "does not move" if self.static_frames else f"is slower than data.min_speed={self.min_speed:g} m/s"
            raise MissingSplit(f"{self.folder} has no {split} frames: the car {static} in all {total} frames.")
        return clips

    def _expected(self, split: str) -> str:
        if split == "test":
            return f"depth_selection/{self.test}/ with the folders image, velodyne_raw and intrinsics is expected."
        if self._drives and set(self._frames) <= {self.test}:
            return (
                f"{self._raw_root} has no images of its drives; <date>/<drive>_sync/image_02/data/<frame>.png of the "
                "raw recordings is expected, or data.raw=<their folder>."
            )
        if split == "validation":
            return "data_depth_velodyne/val/ is expected, or data.validation=3, which holds out three training drives."
        return "data_depth_velodyne/train/<drive>_sync/proj_depth/velodyne_raw/image_02/<frame>.png is expected."

    @cached_property
    def _static(self) -> set[tuple[str, str]]:
        """Sequence and name of each training frame in which the car does not move."""
        return set(self._slow() if self.static_frames is None else self._listed_static(self.static_frames))

    def _listed_static(self, listed: Path) -> Iterator[tuple[str, str]]:
        path = Path(os.path.abspath(listed.expanduser()))
        for line in read_bytes(path).decode(errors="replace").splitlines():
            words = line.split()
            if not words:
                continue
            if len(words) != 3:
                raise DeuxError(f"{path} has the line {shown(line)}: date, drive and frame are expected.")
            for number in self.cameras:
                yield f"{words[1]}_image_{number:02d}", words[2]

    def _slow(self) -> Iterator[tuple[str, str]]:
        """The training frames with less than `min_speed`, measured by the car's navigation system."""
        for drive, split in self._drives.items():
            folder = self._raw_root / drive[:10] / drive / "oxts" / "data"
            if split == "train" and folder.is_dir():
                slow = {path.stem for path in folder.glob("*.txt") if _speed(path) < self.min_speed}
                for number in self.cameras:
                    yield from ((f"{drive}_image_{number:02d}", name) for name in slow)

    @cached_property
    def _drives(self) -> dict[str, str]:
        """The folder of each drive, train or val, sorted by name."""
        root = self._depth_root("velodyne_raw")
        if root is None:
            return {}
        found = {path.name: path.parent.name for split in ("train", "val") for path in (root / split).glob("*_sync")}
        return dict(sorted(found.items()))

    @property
    def _raw_root(self) -> Path:
        """The folder of the raw recordings, which contains a folder for each date."""
        if self.raw is not None:
            return Path(os.path.abspath(self.raw.expanduser()))
        there = (self.folder / name for name in _RAW)
        return next((path for path in there if any(path.glob("*/calib_cam_to_cam.txt"))), self.folder / _RAW[0])

    def _depth_root(self, kind: str) -> Path | None:
        there = (self.folder / name for name in _ROOTS[kind])
        return next((path for path in there if any(path.glob(f"*/*_sync/proj_depth/{kind}"))), None)

    @property
    def _selection(self) -> Path | None:
        there = (self.folder / name / self.test for name in _SELECTIONS)
        return next((path for path in there if path.is_dir()), None)


def _parts(sequence: str) -> tuple[str, str]:
    """Split a sequence's name, such as 2011_09_26_drive_0001_sync_image_02, into drive and camera."""
    drive, _, camera = sequence.rpartition("_image_")
    return drive, f"image_{camera}"


def _rectified(path: Path, camera: str) -> np.ndarray:
    """Read the intrinsics of a rectified camera from calib_cam_to_cam.txt, 3 x 3 float64."""
    name = f"P_rect_{camera[-2:]}:"
    for line in read_bytes(path).decode(errors="replace").splitlines():
        words = line.split()
        if words[:1] == [name] and len(words) == 13:
            try:
                return checked_intrinsics(np.array(words[1:], dtype=np.float64).reshape(3, 4)[:, :3].copy(), path)
            except ValueError:
                break
    raise DeuxError(f"{path} has no line {name} with twelve numbers.")


def _speed(path: Path) -> float:
    """The speed over ground in metres per second."""
    try:
        values = np.array(read_bytes(path).split(), dtype=np.float64)
        return float(np.hypot(values[_FORWARD], values[_LEFTWARD]))
    except (ValueError, IndexError) as error:
        raise DeuxError(f"{path} is not an oxts file: thirty numbers are expected.") from error
