"""Camera poses of a video from common text formats."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from deux.errors import DeuxError
from deux.geometry.poses import inverse
from deux.io.calibration import checked_pose
from deux.io.frame_files import list_files, matching
from deux.io.number_lines import as_numbers, read_lines, read_numbers

TRAJECTORY_FILES = ("poses.txt", "groundtruth.txt", "trajectory.txt", "poses", "pose")
"""Default names of pose files; the last two are folders with a file for each frame."""

TOLERANCE = 0.02
"""Greatest difference in seconds between the time stamps of an image and its pose."""


def read_trajectory(path: Path, stems: Sequence[str], world_to_camera: bool = False) -> dict[str, np.ndarray]:
    """Read the poses of a video's frames.

    Three formats are supported. A folder contains a text file for each frame, with its name or number and a 3 x 4 or
    4 x 4 matrix. A file contains one line for each frame in order, with the 12 or 16 numbers of such a matrix in
    row-major order. A file in the format of the TUM benchmark contains lines of a time stamp in seconds and tx ty tz qx
    qy qz qw; each image gets the pose nearest to the time stamp in its file name, within `TOLERANCE`.

    Args:
        path: the file or folder.
        stems: the images' file names without suffix, in the order of time.
        world_to_camera: whether the files contain world-to-camera matrices.

    Returns:
        Camera-to-world matrices, 4 x 4 float64, by file name. Frames without a pose are missing, and so are those with
        numbers that are not finite, which mark lost tracking.

    Raises:
        DeuxError: the file is missing, its lines have another format, or a matrix is not rigid (such as a transposed
            matrix).
    """
    if path.is_dir():
        files = matching(stems, list_files(path, (".txt",)))
        rows = {stem: read_numbers(file) for stem, file in files.items()}
        found = {stem: checked_pose(row, files[stem]) for stem, row in rows.items() if np.isfinite(row).all()}
    else:
        table = _table(path)
        found = _by_time(table, path, stems) if table.shape[1] == 8 else _by_order(table, path, stems)
    return {stem: inverse(pose) for stem, pose in found.items()} if world_to_camera else found


def _by_order(table: np.ndarray, path: Path, stems: Sequence[str]) -> dict[str, np.ndarray]:
    if len(table) != len(stems):
        raise DeuxError(f"{path} has {len(table)} lines for {len(stems)} images: one line for each is expected.")
    named = zip(stems, table, strict=True)
    return {stem: checked_pose(row, f"{path}, line of {stem},") for stem, row in named if np.isfinite(row).all()}


def _by_time(table: np.ndarray, path: Path, stems: Sequence[str]) -> dict[str, np.ndarray]:
    try:
        times = np.array([[float(stem)] for stem in stems])
    except ValueError as error:
        raise DeuxError(
            f"{path} has poses by time stamp, so the images must be named by time stamp, such as 1305031102.175304.png."
        ) from error
    table = table[np.isfinite(table).all(axis=1)]
    if not len(table):
        return {}
    nearest = KDTree(table[:, :1]).query(times, distance_upper_bound=TOLERANCE)[1]
    return {
        stem: _from_quaternion(table[i, 1:], f"{path}, line of {stem},")
        for stem, i in zip(stems, nearest, strict=True)
        if i < len(table)
    }


def _from_quaternion(row: np.ndarray, where: str) -> np.ndarray:
    """Convert tx ty tz qx qy qz qw to a 4 x 4 matrix."""
    pose = np.eye(4)
    try:
        pose[:3, :3], pose[:3, 3] = Rotation.from_quat(row[3:]).as_matrix(), row[:3]
    except ValueError as error:
        raise DeuxError(f"{where} has a quaternion of zero length.") from error
    return checked_pose(pose, where)


def _table(path: Path) -> np.ndarray:
    """The numbers of a text file, one row for each line."""
    lines = read_lines(path)
    widths = sorted({len(line) for line in lines})
    if len(widths) != 1 or widths[0] not in (8, 12, 16):
        raise DeuxError(
            f"{path} has lines of {', '.join(map(str, widths)) or 'no'} numbers: a pose must be 12 or 16 numbers, the "
            "rows of its matrix, or a time stamp and tx ty tz qx qy qz qw."
        )
    return as_numbers(lines, path)
