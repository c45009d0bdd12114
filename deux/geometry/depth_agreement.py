"""Agreement of a depth map with those of other frames of its sequence: the geometric check of multi-view fusion.

A depth map that blurs the step between two surfaces puts its pixels into the empty space between them, and each frame
puts them elsewhere, along its own rays. A point is believed where other cameras of the same world measure it too:

    X = pose (d K^-1 (u, v, 1)),    (u', v', z') = K' pose'^-1 X,    |z' / d'(u', v') - 1| <= tolerance.

Between its pixels 1 / d' is interpolated, which is linear on planes, so that slanted floors agree in small images too.

Frames that see almost the same rays, a centimetre away or turned in place, would confirm any mistake; so only frames
count whose cameras stand apart (`SourceRule`).
"""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import cv2
import numpy as np

from deux.geometry.point_cloud import unproject
from deux.geometry.poses import inverse
from deux.geometry.source_frames import SourceRule

REACH = 10
"""Frames before and after, of those with poses, among which the frames that confirm are chosen."""

_CONFIRMATIONS = 2
"""Frames that must agree with a pixel; fewer where fewer stand apart."""


class PosedDepth(NamedTuple):
    """A depth map and the camera that took it.

    Args:
        depth: H x W metres, 0 = none.
        intrinsics: 3 x 3, for pixel centres at integers.
        pose: 4 x 4 camera-to-world.
    """

    depth: np.ndarray
    intrinsics: np.ndarray
    pose: np.ndarray


def confirming_frames(poses: Sequence[np.ndarray], index: int) -> list[int]:
    """Which frames of a sequence can confirm the depth of one: before it the nearest and the farthest, and after it.

    Args:
        poses: 4 x 4 camera-to-world of each frame, in order of time.
        index: of the frame in question.

    Returns:
        At most four indices.
    """
    rule = SourceRule()
    chosen: list[int] = []
    for side in (range(index - 1, index - REACH - 1, -1), range(index + 1, index + REACH + 1)):
        apart = [other for other in side if 0 <= other < len(poses) and rule.apart(poses[index], poses[other])]
        chosen += apart if len(apart) < 2 else [apart[0], apart[-1]]
    return chosen


def agreeing_pixels(target: PosedDepth, others: Iterable[PosedDepth], tolerance: float) -> np.ndarray:
    """The pixels of a depth map that enough other frames measure at the same place.

    Args:
        target: the depth map in question.
        others: those of the frames that can confirm it, each of any size.
        tolerance: greatest difference of both depths as a fraction of what the other frame measures.

    Returns:
        H x W bool; all true where there is no other frame.

    Example:
        >>> camera, ahead = np.eye(3), np.eye(4)
        >>> target = PosedDepth(np.array([[2.0, 3.0]]), camera, ahead)
        >>> agreeing_pixels(target, [PosedDepth(np.full((1, 4), 2.0), camera, ahead)], 0.03).tolist()
        [[True, False]]
    """
    points = unproject(target.depth, target.intrinsics, target.pose)
    confirmations, asked = np.zeros(target.depth.shape, np.int64), 0
    for other in others:
        confirmations += _measures(other, points, tolerance)
        asked += 1
    return confirmations >= min(_CONFIRMATIONS, asked)


def _measures(frame: PosedDepth, points: np.ndarray, tolerance: float) -> np.ndarray:
    """Whether a frame measures the points, H x W x 3 metres, where they are."""
    to_camera = frame.intrinsics @ inverse(frame.pose)[:3]
    seen = points @ to_camera[:, :3].T + to_camera[:, 3]
    distance = seen[..., 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        pixels = (seen[..., :2] / distance[..., None]).astype(np.float32)
        inverse_depth = np.where(frame.depth > 0, 1 / frame.depth, np.nan).astype(np.float32)
    height, width = frame.depth.shape
    inside = (distance > 0) & ((pixels >= -0.5) & (pixels <= (width - 0.5, height - 0.5))).all(axis=-1)
    # Beside pixels without depth the value is NaN, which agrees with nothing.
    measured = cv2.remap(
        inverse_depth, pixels[..., 0], pixels[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    )
    return inside & (np.abs(distance * measured - 1) <= tolerance)
