"""What a reader gives for a frame, checked against its contract: a wrong array is an error that names the reader."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from deux.broken_contracts import broken_contract
from deux.contracts import FrameReference, Reader, Triplet
from deux.errors import DeuxError, kind_of, shown
from deux.io.calibration import checked_intrinsics, checked_pose
from deux.registry import registry


def triplets_of(reader: Reader, split: str, offsets: tuple[int, ...]) -> list[Triplet]:
    """The targets of a split with their source frames, by `Reader.triplets`.

    Raises:
        DeuxError: as `Reader.triplets`, or the result is not a list of triplets.
    """
    found = reader.triplets(split, offsets)
    _check_triplets(reader, found, "triplets")
    return found


def chosen_triplets_of(reader: Reader, split: str) -> list[Triplet] | None:
    """The targets of a split with listed source frames, by `Reader.chosen_triplets`; None if nothing is listed.

    Raises:
        DeuxError: as `Reader.chosen_triplets`, or the result is not a list of triplets.
    """
    found = reader.chosen_triplets(split)
    if found is not None:
        _check_triplets(reader, found, "chosen_triplets")
    return found


def image_of(reader: Reader, frame: FrameReference) -> np.ndarray:
    """The colour image, H x W x 3 uint8.

    Raises:
        DeuxError: as `Reader.image`, or the result is not such an array.
    """
    image = reader.image(frame)
    right = isinstance(image, np.ndarray) and image.dtype == np.uint8
    if not (right and image.ndim == 3 and image.shape[2] == 3):
        raise _wrong_array(reader, "image", frame, image, "H x W x 3, uint8")
    return image


def sparse_depth_of(reader: Reader, frame: FrameReference) -> np.ndarray:
    """The sparse points, H x W float32 metres, 0 = none.

    Raises:
        DeuxError: as `Reader.sparse_depth`, or the result is not such an array.
    """
    depth = reader.sparse_depth(frame)
    _check_depth(reader, "sparse_depth", frame, depth)
    return depth


def ground_truth_of(reader: Reader, frame: FrameReference) -> np.ndarray | None:
    """The true depth, H x W float32 metres, 0 = none; None if there is none.

    Raises:
        DeuxError: as `Reader.ground_truth`, or the result is neither such an array nor None.
    """
    depth = reader.ground_truth(frame)
    if depth is not None:
        _check_depth(reader, "ground_truth", frame, depth)
    return depth


def intrinsics_of(reader: Reader, frame: FrameReference) -> np.ndarray:
    """The matrix of the camera that took the image, 3 x 3 float64.

    Raises:
        DeuxError: as `Reader.intrinsics`, or the result is not the matrix of a pinhole camera.
    """
    intrinsics = reader.intrinsics(frame)
    _check_matrix(reader, "intrinsics", frame, intrinsics, 3, checked_intrinsics)
    return intrinsics


def pose_of(reader: Reader, frame: FrameReference) -> np.ndarray | None:
    """The camera's pose, camera-to-world, 4 x 4 float64; None if there is none.

    Raises:
        DeuxError: as `Reader.pose`, or the result is neither None nor a rigid transform.
    """
    pose = reader.pose(frame)
    if pose is None:
        return None
    _check_matrix(reader, "pose", frame, pose, 4, checked_pose)
    return pose


def _check_triplets(reader: Reader, found: object, method: str) -> None:
    """Raise DeuxError unless the result of a reader's method is a list of `Triplet`; plain tuples are refused."""
    invalid: list[object] = [found]
    if isinstance(found, list | tuple):
        invalid = [one for one in found if not (isinstance(one, Triplet) and _has_frame_references(one))]
    if invalid:
        wanted = "a list of deux.contracts.Triplet(target, (source, ...)), each of these a FrameReference"
        raise broken_contract(reader, shown(invalid[0], most=200), wanted, method)


def _has_frame_references(triplet: Triplet) -> bool:
    target, sources = triplet
    return isinstance(sources, tuple) and all(isinstance(frame, FrameReference) for frame in (target, *sources))


def _check_depth(reader: Reader, method: str, frame: FrameReference, depth: object) -> None:
    """Raise DeuxError unless depth is H x W float32, finite and not negative."""
    if not (isinstance(depth, np.ndarray) and depth.dtype == np.float32 and depth.ndim == 2):
        raise _wrong_array(reader, method, frame, depth, "H x W, float32, in metres")
    nearest, farthest = depth.min(initial=0.0), depth.max(initial=0.0)
    if not (nearest >= 0.0 and farthest < np.inf):  # true for NaN
        given = f"depth from {nearest:g} to {farthest:g} m for {_named(reader, frame)}"
        raise broken_contract(reader, given, "finite and 0 where there is none", method)


def _check_matrix(
    reader: Reader,
    method: str,
    frame: FrameReference,
    matrix: object,
    side: int,
    check: Callable[[np.ndarray, str], np.ndarray],
) -> None:
    """Raise DeuxError unless a matrix has this many rows and columns, is float64 and passes the check of its values."""
    if not (isinstance(matrix, np.ndarray) and matrix.dtype == np.float64 and matrix.shape == (side, side)):
        raise _wrong_array(reader, method, frame, matrix, f"{side} x {side}, float64")
    try:
        check(matrix, f"the {method} of {_named(reader, frame)}")
    except DeuxError as error:
        raise DeuxError(f"{registry().called(reader)}: {error}") from error


def _wrong_array(reader: Reader, method: str, frame: FrameReference, found: object, wanted: str) -> DeuxError:
    given = f"{kind_of(found)} for {_named(reader, frame)}"
    return broken_contract(reader, given, f"an array of {wanted}", method)


def _named(reader: Reader, frame: FrameReference) -> str:
    return f"frame {frame.name} of {frame.sequence} in {reader.folder}"
