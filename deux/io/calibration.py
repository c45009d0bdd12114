"""Camera matrices and poses as text files, with the full precision of float64."""

import io
from pathlib import Path

import numpy as np

from deux.errors import DeuxError
from deux.geometry.camera import FOCAL_LENGTHS, is_focal_length
from deux.io.atomic import write_atomically
from deux.io.number_lines import read_numbers

SHORTEST_FOCUS = 0.05
"""Least plausible focal length as a fraction of the image's side, which is a field of view of 168 degrees."""

FARTHEST = 1e8
"""Greatest distance of cameras from the origin in metres, enough for coordinates of map projections."""

OFF_CENTRE = 0.2
"""Distance of the principal point from the image's centre, as a fraction of its side, above which to warn."""


def write_matrix(path: Path, matrix: np.ndarray) -> None:
    """Write a float64 matrix as text, without loss of precision, atomically."""
    text = io.BytesIO()
    np.savetxt(text, matrix, fmt="%.18e")
    write_atomically(path, text.getvalue())


def read_pose(path: Path) -> np.ndarray:
    """Read a camera-to-world matrix, 4 x 4 float64, from a file of 3 or 4 rows of 4 numbers.

    Raises:
        DeuxError: the file is missing or does not contain a finite rigid pose.
    """
    return checked_pose(read_numbers(path), path)


def checked_pose(numbers: np.ndarray, path: Path | str) -> np.ndarray:
    """Check a camera-to-world matrix of 12 or 16 numbers; returns 4 x 4 float64.

    Args:
        numbers: the numbers, in row-major order.
        path: the file, for messages.

    Raises:
        DeuxError: the matrix is not a finite rigid pose.
    """
    if numbers.size not in (12, 16) or not np.isfinite(numbers).all():
        raise DeuxError(f"{path} is not a pose: 3 or 4 rows of 4 finite numbers are expected.")
    pose = np.eye(4)
    pose[:3] = numbers.ravel()[:12].reshape(3, 4)
    if numbers.size == 16 and np.abs(numbers.ravel()[12:] - pose[3]).max() > 1e-6:
        raise DeuxError(f"{path} is not a pose: its fourth row is not 0 0 0 1, so it may be transposed.")
    if np.abs(pose[:3, :3] @ pose[:3, :3].T - np.eye(3)).max() > 1e-3:
        raise DeuxError(f"{path} is not a pose: its first 3 x 3 numbers are not a rotation.")
    if np.linalg.det(pose[:3, :3]) < 0:
        raise DeuxError(f"{path} is not a pose: its first 3 x 3 numbers are a reflection, with a determinant of -1.")
    if np.abs(pose[:3, 3]).max() > FARTHEST:
        farthest = np.abs(pose[:3, 3]).max()
        raise DeuxError(f"{path} has a position of {farthest:.3g} m: it must be within {FARTHEST:.0g} m of the origin.")
    return pose


def read_intrinsics(path: Path) -> np.ndarray:
    """Read a camera's intrinsics, 3 x 3 float64.

    Raises:
        DeuxError: the file is missing or does not contain the matrix of a pinhole camera.
    """
    return checked_intrinsics(read_numbers(path), path)


def checked_intrinsics(numbers: np.ndarray, path: Path | str) -> np.ndarray:
    """Check a camera matrix of nine numbers; returns 3 x 3.

    Args:
        numbers: the numbers, in row-major order.
        path: the file, for messages.

    Raises:
        DeuxError: the matrix is not that of a pinhole camera.
    """
    if numbers.size != 9 or not np.isfinite(numbers).all():
        raise DeuxError(f"{path} is not a camera matrix: 3 rows of 3 finite numbers are expected.")
    intrinsics = numbers.reshape(3, 3)
    focal_lengths = intrinsics[[0, 1], [0, 1]]
    if (focal_lengths > 0).all() and not all(map(is_focal_length, focal_lengths)):
        raise DeuxError(
            f"{path} has the focal lengths {focal_lengths[0]:g} and {focal_lengths[1]:g}: they must be in pixels, from "
            f"{FOCAL_LENGTHS[0]:g} to {FOCAL_LENGTHS[1]:g}."
        )
    if (focal_lengths <= 0).any() or intrinsics[1, 0] != 0 or not np.array_equal(intrinsics[2], [0.0, 0.0, 1.0]):
        raise DeuxError(
            f"{path} is not the matrix of a pinhole camera: fx s cx, 0 fy cy and 0 0 1 are expected, with positive fx "
            "and fy."
        )
    return intrinsics


def camera_warning(intrinsics: np.ndarray, height: int, width: int, where: str) -> str | None:
    """The warning for intrinsics that do not fit the size of an image; None if they are plausible.

    Intrinsics that are normalised by the image's size have focal lengths of about 1 and a principal point below 1.

    Args:
        intrinsics: 3 x 3, for pixel centres at integers.
        height: height of the image in pixels.
        width: width of the image in pixels.
        where: the name of the intrinsics in the message, such as their file.
    """
    (fx, fy), (x, y) = intrinsics[[0, 1], [0, 1]], intrinsics[:2, 2]
    size = f"{width} x {height} pixels"
    short = fx < SHORTEST_FOCUS * width or fy < SHORTEST_FOCUS * height
    too_short = f"the focal lengths {fx:g} and {fy:g} are too short for an image of {size}"
    if short and max(abs(x), abs(y)) <= 1:
        return (
            f"{too_short}: if {where} is normalised by the image's size, multiply its first row by the width {width} "
            f"and its second row by the height {height}."
        )
    if not (0 <= x < width and 0 <= y < height):
        return (
            f"the principal point ({x:g}, {y:g}) is outside of the image of {size}: {where} seems to belong to images "
            "of another size."
        )
    if max(abs((x + 0.5) / width - 0.5), abs((y + 0.5) / height - 0.5)) > OFF_CENTRE:
        return (
            f"the principal point ({x:g}, {y:g}) is far from the centre of the image of {size}: {where} seems to "
            f"belong to images of about {2 * x + 1:.0f} x {2 * y + 1:.0f} pixels."
        )
    if short:
        return f"{too_short}: {where} must be in pixels, not in millimetres."
    return None
