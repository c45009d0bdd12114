"""Multi-view consistency check of depth maps, as in multi-view fusion.

Depth maps that are blurred at an edge have points in the empty space between two surfaces, at different positions in
each frame. A point is accepted if the depth maps of other frames agree with it:

    X = pose (d K^-1 (u, v, 1)),    (u', v', z') = K' pose'^-1 X,    |z' / d'(u', v') - 1| <= tolerance.

Between pixels 1 / d' is interpolated, which is linear on planes, so that slanted floors agree in small images too.

Frames from almost the same position would confirm any error; therefore only frames with a sufficient baseline are used
(`SourceRule`).
"""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import cv2
import numpy as np

from deux.geometry.point_cloud import unproject
from deux.geometry.poses import inverse
from deux.geometry.source_frames import SourceRule

REACH = 10
"""Number of frames with poses, before and after a frame, from which the confirming frames are selected."""

_CONFIRMATIONS = 2
"""Number of frames that must agree with a pixel; fewer if fewer have a sufficient baseline."""


class PosedDepth(NamedTuple):
    """A depth map with intrinsics and pose.

    Args:
        depth: H x W metres, 0 = none.
        intrinsics: 3 x 3, for pixel centres at integers.
        pose: 4 x 4 camera-to-world.
    """

    depth: np.ndarray
    intrinsics: np.ndarray
    pose: np.ndarray


def confirming_frames(poses: Sequence[np.ndarray], index: int) -> list[int]:
    """Select the frames that can confirm the depth of a frame: the nearest and farthest before it and after it.

    Args:
        poses: 4 x 4 camera-to-world of each frame, in temporal order.
        index: index of the frame to check.

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
    """Find the pixels of a depth map that agree with enough other frames.

    Args:
        target: the depth map to check.
        others: depth maps of the confirming frames, of any size.
        tolerance: maximum difference of both depths relative to that of the other frame.

    Returns:
        H x W bool; all true without other frames.

    Example:
        >>> camera, ahead = np.eye(3), np.eye(4)
        >>> target = PosedDepth(np.array([[2.0, 3.0]]), camera, ahead)
        >>> agreeing_pixels(target, [PosedDepth(np.full((1, 4), 2.0), camera, ahead)], 0.03).tolist()
        [[True, False]]
    """
    points = unproject(target.depth, target.intrinsics, target.pose)
    confirmations, count = np.zeros(target.depth.shape, np.int64), 0
    for other in others:
        confirmations += _agrees(other, points, tolerance)
        count += 1
    return confirmations >= min(_CONFIRMATIONS, count)


def _agrees(frame: PosedDepth, points: np.ndarray, tolerance: float) -> np.ndarray:
    """Whether the depth map of a frame agrees with the points, H x W x 3 metres."""
    to_camera = frame.intrinsics @ inverse(frame.pose)[:3]
    projected = points @ to_camera[:, :3].T + to_camera[:, 3]
    distance = projected[..., 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        pixels = (projected[..., :2] / distance[..., None]).astype(np.float32)
        inverse_depth = np.where(frame.depth > 0, 1 / frame.depth, np.nan).astype(np.float32)
    height, width = frame.depth.shape
    inside = (distance > 0) & ((pixels >= -0.5) & (pixels <= (width - 0.5, height - 0.5))).all(axis=-1)
    # Next to pixels without depth the value is NaN, for which the comparison below is false.
    measured = cv2.remap(
        inverse_depth, pixels[..., 0], pixels[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    )
    return inside & (np.abs(distance * measured - 1) <= tolerance)
