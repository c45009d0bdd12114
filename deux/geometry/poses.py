"""Rigid poses as 4 x 4 camera-to-world matrices in metres, with OpenCV camera axes and a Y-up world."""

import math

import numpy as np


def camera_pose(x: float, y: float, z: float, yaw: float) -> np.ndarray:
    """Camera-to-world matrix of a level camera at (x, y, z).

    At yaw 0 the camera looks along the world's -Z; a positive yaw (radians) turns it left, counter-clockwise
    seen from above.

    Returns:
        4 x 4 float64; its columns are the camera's right, down and forward axes and its centre.

    Example:
        >>> camera_pose(1.0, 1.25, 2.0, yaw=0.0)[:, 2].tolist()  # forward is -Z
        [-0.0, 0.0, -1.0, 0.0]
    """
    s, c = math.sin(yaw), math.cos(yaw)
    return np.array([[c, 0.0, -s, x], [0.0, -1.0, 0.0, y], [-s, 0.0, -c, z], [0.0, 0.0, 0.0, 1.0]])


def yaw_of(pose: np.ndarray) -> float:
    """Heading in radians, in (-pi, pi], of a level camera-to-world matrix; the inverse of `camera_pose`.

    Example:
        >>> round(yaw_of(camera_pose(0.0, 1.25, 0.0, yaw=0.5)), 6)
        0.5
    """
    return math.atan2(-pose[0, 2], -pose[2, 2])


def inverse(pose: np.ndarray) -> np.ndarray:
    """Inverse of rigid 4 x 4 matrices (... x 4 x 4), exact for rotations.

    Example:
        >>> pose = camera_pose(1.0, 1.25, 2.0, yaw=0.5)
        >>> np.allclose(inverse(pose) @ pose, np.eye(4))
        True
    """
    rotation = np.swapaxes(pose[..., :3, :3], -1, -2)
    result = np.zeros_like(pose)
    result[..., :3, :3] = rotation
    result[..., :3, 3] = -np.einsum("...ij,...j->...i", rotation, pose[..., :3, 3])
    result[..., 3, 3] = 1.0
    return result


def source_from_target(target: np.ndarray, source: np.ndarray) -> np.ndarray:
    """Transform from the target camera to the source camera, from the poses of both.

    Example:
        >>> target, source = camera_pose(0.0, 1.25, 0.0, yaw=0.0), camera_pose(0.5, 1.25, 0.0, yaw=0.0)
        >>> source_from_target(target, source)[:3, 3].tolist()  # half a metre to the left of the source
        [-0.5, 0.0, 0.0]
    """
    return inverse(source) @ target


def absorb_intrinsics(motion: np.ndarray, intrinsics: np.ndarray, source_intrinsics: np.ndarray) -> np.ndarray:
    """Change a relative pose so that the target's intrinsics can be used for both cameras.

    K_s p = K_t A p with A = K_t^-1 K_s: the difference between the cameras (autofocus, zoom) becomes a shear and
    scaling perpendicular to the optical axis of the source. Depth is unchanged, and crops, resizing and mirroring apply
    to A p as to p.

    Args:
        motion: p, 4 x 4 transform from the target camera to the source camera.
        intrinsics: K_t, 3 x 3, upper triangular.
        source_intrinsics: K_s, 3 x 3.

    Returns:
        A p, 4 x 4; p itself if the intrinsics are equal.

    Example:
        >>> target, twice = np.diag([100.0, 100.0, 1.0]), np.diag([200.0, 200.0, 1.0])
        >>> absorb_intrinsics(np.eye(4), target, twice)[:3, :3].tolist()
        [[2.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 1.0]]
    """
    if np.array_equal(intrinsics, source_intrinsics):
        return motion
    stretch = np.eye(4)
    stretch[:3, :3] = np.linalg.solve(intrinsics, source_intrinsics)
    return stretch @ motion


def motion(first: np.ndarray, second: np.ndarray) -> tuple[float, float]:
    """Distance in metres and rotation angle in degrees between two camera-to-world matrices.

    Example:
        >>> distance, angle = motion(camera_pose(0.0, 1.25, 0.0, yaw=0.0), camera_pose(3.0, 1.25, 4.0, yaw=0.1))
        >>> round(distance, 6), round(angle, 3)
        (5.0, 5.73)
    """
    relative = source_from_target(first, second)
    cosine = (np.trace(relative[:3, :3]) - 1.0) / 2.0
    return float(np.linalg.norm(relative[:3, 3])), math.degrees(math.acos(min(1.0, max(-1.0, cosine))))
