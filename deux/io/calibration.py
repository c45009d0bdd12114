"""Camera matrices as text files, with the full precision of float64."""

import io
from pathlib import Path

import numpy as np

from deux.errors import DeuxError
from deux.geometry.camera import FOCAL_LENGTHS, is_focal_length
from deux.io.atomic import write_atomically
from deux.io.number_lines import read_numbers

SHORTEST_FOCUS = 0.05
"""Focal length as a part of the image's side: with a shorter one a pinhole camera would see more than 168 degrees."""

FARTHEST = 1e8
"""Metres from the origin within which positions of cameras lie; those of map projections do."""

OFF_CENTRE = 0.2
"""Part of the image's side by which a principal point may lie off the middle without a word."""


def write_matrix(path: Path, matrix: np.ndarray) -> None:
    """Write a float64 matrix row by row so that reading returns the same bits, atomically."""
    text = io.BytesIO()
    np.savetxt(text, matrix, fmt="%.18e")
    write_atomically(path, text.getvalue())


def read_pose(path: Path) -> np.ndarray:
    """Read a camera-to-world matrix, 4 x 4 float64; the file holds 3 or 4 rows of 4 numbers.

    Raises:
        DeuxError: the file is missing or does not hold a finite rigid pose.
    """
    return checked_pose(read_numbers(path), path)


def checked_pose(numbers: np.ndarray, path: Path | str) -> np.ndarray:
    """Numbers as a camera-to-world matrix, 4 x 4 float64; `path` is where they were read. Raises as `read_pose`."""
    if numbers.size not in (12, 16) or not np.isfinite(numbers).all():
        raise DeuxError(f"{path} does not hold a pose: 3 or 4 rows of 4 finite numbers are expected.")
    pose = np.eye(4)
    pose[:3] = numbers.ravel()[:12].reshape(3, 4)
    if not np.allclose(numbers.ravel()[12:], pose[3, : numbers.size - 12], atol=1e-6):
        raise DeuxError(f"{path} does not hold a pose: its fourth row is not 0 0 0 1, so it may be transposed.")
    if not np.allclose(pose[:3, :3] @ pose[:3, :3].T, np.eye(3), atol=1e-3):
        raise DeuxError(f"{path} does not hold a pose: its first 3 x 3 numbers are not a rotation.")
    if np.linalg.det(pose[:3, :3]) < 0:
        raise DeuxError(f"{path} does not hold a pose: its first 3 x 3 numbers mirror, with a determinant of -1.")
    if np.abs(pose[:3, 3]).max() > FARTHEST:
        raise DeuxError(f"{path} holds a position of {np.abs(pose[:3, 3]).max():.3g} m, farther than {FARTHEST:.0g} m.")
    return pose


def read_intrinsics(path: Path) -> np.ndarray:
    """Read a camera's 3 x 3 float64 intrinsics.

    Raises:
        DeuxError: the file is missing or its matrix is not that of a pinhole camera.
    """
    return checked_intrinsics(read_numbers(path), path)


def checked_intrinsics(numbers: np.ndarray, path: Path) -> np.ndarray:
    """Nine numbers as a camera's 3 x 3 intrinsics; `path` is where they were read. Raises as `read_intrinsics`."""
    if numbers.size != 9 or not np.isfinite(numbers).all():
        raise DeuxError(f"{path} does not hold intrinsics: 3 rows of 3 finite numbers are expected.")
    intrinsics = numbers.reshape(3, 3)
    focal_lengths = intrinsics[[0, 1], [0, 1]]
    if (focal_lengths > 0).all() and not all(map(is_focal_length, focal_lengths)):
        raise DeuxError(
            f"{path} holds the focal lengths {focal_lengths[0]:g} and {focal_lengths[1]:g}: they are in pixels, from "
            f"{FOCAL_LENGTHS[0]:g} to {FOCAL_LENGTHS[1]:g}."
        )
    if (focal_lengths <= 0).any() or intrinsics[1, 0] != 0 or not np.array_equal(intrinsics[2], [0.0, 0.0, 1.0]):
        raise DeuxError(
            f"{path} does not hold the intrinsics of a pinhole camera: fx s cx, 0 fy cy and 0 0 1 are expected, with "
            "positive fx and fy."
        )
    return intrinsics


def camera_warning(intrinsics: np.ndarray, height: int, width: int, where: str) -> str | None:
    """The sentence for intrinsics that seem to belong to no image of this size; None where they may.

    Intrinsics that are divided by the image's size have focal lengths of about 1 and a principal point below 1.

    Args:
        intrinsics: 3 x 3, for pixel centres at integers.
        height: of the image, pixels.
        width: of the image, pixels.
        where: what the intrinsics are called, such as their file.
    """
    (fx, fy), (x, y) = intrinsics[[0, 1], [0, 1]], intrinsics[:2, 2]
    size = f"{width} x {height} pixels"
    short = fx < SHORTEST_FOCUS * width or fy < SHORTEST_FOCUS * height
    too_short = f"the focal lengths {fx:g} and {fy:g} are too short for an image of {size}"
    if short and max(abs(x), abs(y)) <= 1:
        return (
            f"{too_short}: if {where} is divided by the image's size, multiply its first row by the width {width} and "
            f"its second row by the height {height}."
        )
    if not (0 <= x < width and 0 <= y < height):
        return (
            f"the principal point ({x:g}, {y:g}) lies outside the image of {size}: {where} seems to belong to images "
            "of another size."
        )
    if max(abs((x + 0.5) / width - 0.5), abs((y + 0.5) / height - 0.5)) > OFF_CENTRE:
        return (
            f"the principal point ({x:g}, {y:g}) lies far from the middle of the image of {size}: {where} seems to "
            f"belong to images of about {2 * x + 1:.0f} x {2 * y + 1:.0f} pixels."
        )
    if short:
        return f"{too_short}: those of {where} are in pixels, not in millimetres."
    return None
