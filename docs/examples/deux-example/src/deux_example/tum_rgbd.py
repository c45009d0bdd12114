"""A reader of RGB-D videos in the layout of the TUM benchmark (Sturm et al., IROS 2012)."""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from deux.collection.sparse import SparseSettings, sample_sparse
from deux.contracts import FrameReference, MissingSplit, Reader, Triplet
from deux.errors import DeuxError, near_matches
from deux.io.atomic import read_bytes
from deux.io.calibration import checked_pose
from deux.io.images import read_depth, read_image

DEPTH_SCALE = 5000.0
"""Stored depth values per metre."""


class _Recorded(NamedTuple):
    """What belongs to one time stamp; the pose is 4 x 4 float64, camera-to-world."""

    image: Path
    depth: Path
    pose: np.ndarray | None


@dataclass(frozen=True)
class TumRgbd(Reader):
    """Reads a folder of videos, each a folder with the lists rgb.txt, depth.txt and, optionally, groundtruth.txt.

    A line of a list holds a time stamp in seconds and an image's path, or tx ty tz qx qy qz qw of the camera's pose.
    Each colour image takes the depth map and the pose that are nearest in time; images that lack one are left out.
    The depth is the ground truth, and sparse points are sampled from it at the image's corners.

    Args:
        folder: the videos' folder.
        validation: names of the videos of this split.
        test: names of the videos of this split; all that are in neither make up "train".
        fx: focal length in pixels, by default the one that the benchmark gives for uncalibrated use.
        fy: focal length along the image's columns, pixels.
        cx: column of the principal point, pixels.
        cy: row of the principal point, pixels.
        tolerance: seconds by which a depth map or a pose may be apart from its colour image.
        density: number of sparse points as a fraction of the pixels.

    Raises:
        DeuxError: there is no video in the folder, or not the one that a split names.
    """

    folder: Path
    validation: tuple[str, ...] = ()
    test: tuple[str, ...] = ()
    fx: float = 525.0
    fy: float = 525.0
    cx: float = 319.5
    cy: float = 239.5
    tolerance: float = 0.02
    density: float = SparseSettings.density

    def __post_init__(self) -> None:
        names = [path.parent.name for path in self.folder.glob("*/rgb.txt")]
        if not names:
            raise DeuxError(f"{self.folder} has no videos in TUM's layout: none of its folders has an rgb.txt.")
        for name in (*self.validation, *self.test):
            if name not in names:
                raise DeuxError(f"{self.folder} has no video {name!r}: {near_matches(name, names)}")

    def triplets(self, split: str, offsets: tuple[int, ...]) -> list[Triplet]:
        """The frames of the split's videos, with the frames at the offsets if all of them are in the same video."""
        chosen = {"validation": self.validation, "test": self.test}
        chosen["train"] = tuple(sorted(set(self._videos) - {*self.validation, *self.test}))
        found = []
        for video in chosen.get(split, ()):
            frames = [FrameReference(video, name) for name in self._videos[video]]
            for i, target in enumerate(frames):
                complete = all(0 <= i + offset < len(frames) for offset in offsets)
                found.append(Triplet(target, tuple(frames[i + offset] for offset in offsets if complete)))
        if not found:
            raise MissingSplit(f"{self.folder} has no {split} frames: data.{split} may name videos.")
        return found

    def image(self, frame: FrameReference) -> np.ndarray:
        """H x W x 3 uint8."""
        return read_image(self._recorded(frame).image)

    def intrinsics(self, frame: FrameReference) -> np.ndarray:
        """3 x 3 float64, the same for all videos."""
        return np.array([[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])

    def sparse_depth(self, frame: FrameReference) -> np.ndarray:
        """H x W float32 metres, 0 = none; points of the ground truth."""
        image, depth = self.image(frame), self.ground_truth(frame)
        if image.shape[:2] != depth.shape:
            raise DeuxError(f"{self._recorded(frame).depth} has not the size of its image, {image.shape[:2]}.")
        return sample_sparse(image, depth, SparseSettings(self.density))

    def ground_truth(self, frame: FrameReference) -> np.ndarray:
        """H x W float32 metres, 0 = none."""
        return read_depth(self._recorded(frame).depth, DEPTH_SCALE)

    def pose(self, frame: FrameReference) -> np.ndarray | None:
        """4 x 4 float64, camera-to-world; None for a video without groundtruth.txt."""
        pose = self._recorded(frame).pose
        return None if pose is None else pose.copy()

    def _recorded(self, frame: FrameReference) -> _Recorded:
        try:
            return self._videos[frame.sequence][frame.name]
        except KeyError:
            raise DeuxError(f"{self.folder} has no frame {frame.name} of {frame.sequence}.") from None

    @cached_property
    def _videos(self) -> dict[str, dict[str, _Recorded]]:
        """The frames of each video by their time stamps as text, in the order of time."""
        folders = sorted(path.parent for path in self.folder.glob("*/rgb.txt"))
        return {folder.name: _associate(folder, self.tolerance) for folder in folders}


def _associate(folder: Path, tolerance: float) -> dict[str, _Recorded]:
    """The frames of a video, by time stamps of equal length, so that names sort as times do."""
    times, images = _read_list(folder / "rgb.txt", 1)
    depth_times, depths = _read_list(folder / "depth.txt", 1)
    depth = _nearest(times, depth_times, tolerance)
    complete = depth < len(depths)
    poses: dict[int, np.ndarray] = {}
    if (trajectory := folder / "groundtruth.txt").exists():
        pose_times, rows = _read_list(trajectory, 7)
        pose = _nearest(times, pose_times, tolerance)
        complete &= pose < len(rows)
        poses = {i: _pose(rows[pose[i]], trajectory) for i in np.flatnonzero(complete).tolist()}
    return {
        f"{times[i]:017.6f}": _Recorded(folder / images[i][0], folder / depths[depth[i]][0], poses.get(i))
        for i in np.flatnonzero(complete).tolist()
    }


def _read_list(path: Path, columns: int) -> tuple[np.ndarray, list[list[str]]]:
    """The time stamps of a list in ascending order, seconds, and the further columns of each of its lines."""
    text = read_bytes(path).decode(errors="replace")
    if not text.endswith("\n"):
        raise DeuxError(f"{path} is cut off: its last line does not end.")
    rows = [line.split() for line in text.splitlines() if line.strip() and not line.startswith("#")]
    try:
        times = np.asarray_chkfinite([row[0] for row in rows], dtype=np.float64)
    except ValueError as error:
        raise DeuxError(f"{path} is no list: a line does not begin with a time stamp.") from error
    if any(len(row) != 1 + columns for row in rows):
        raise DeuxError(f"{path} is no list: each line must hold a time stamp and {columns} more.")
    order = np.argsort(times, kind="stable")
    return times[order], [rows[i][1:] for i in order]


def _nearest(times: np.ndarray, others: np.ndarray, tolerance: float) -> np.ndarray:
    """For each time the index of the nearest of the other times; their number where none is within the tolerance."""
    return KDTree(others[:, None]).query(times[:, None], distance_upper_bound=tolerance)[1]


def _pose(numbers: list[str], path: Path) -> np.ndarray:
    """tx ty tz qx qy qz qw as a 4 x 4 matrix."""
    pose = np.eye(4)
    try:
        values = np.asarray_chkfinite(numbers, dtype=np.float64)
        pose[:3, :3], pose[:3, 3] = Rotation.from_quat(values[3:]).as_matrix(), values[:3]
    except ValueError as error:
        raise DeuxError(f"{path} holds {' '.join(numbers)}, which is no translation and quaternion.") from error
    return checked_pose(pose, path)
