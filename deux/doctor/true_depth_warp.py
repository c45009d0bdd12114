"""Consistency of depth, poses and intrinsics of recorded frames, measured by the warp error of the true depth.

A frame is reconstructed from its neighbour with its true depth and the recorded poses (Eq. 1). If all of them are
right, the colours agree better than without motion. A wrong pose convention or unit is detected in this way.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
import torch

from deux.data.depth_unit import COMMON_SCALES
from deux.geometry.poses import absorb_intrinsics, inverse, source_from_target
from deux.geometry.reprojection import reproject

MOST = 0.5
"""Maximal warp error of a consistent recording, relative to the error without motion."""

CLEARLY = 0.75
"""Maximal error of another convention, relative to the warp error, to be suggested. The margin is needed since inverted
poses of a turning camera are close to the right ones."""

STILL = 2.0
"""Mean colour difference (0-255) of neighbouring frames below which the camera moves too little for a conclusion."""

_AXES = np.diag([1.0, -1.0, -1.0, 1.0])

CONVENTIONS: Mapping[str, Callable[[np.ndarray], np.ndarray]] = MappingProxyType(
    {
        "the poses are world-to-camera": inverse,
        "the camera's axes are OpenGL's (x right, y up, z backward)": lambda pose: pose @ _AXES,
        "the poses are world-to-camera with OpenGL's axes": lambda pose: inverse(pose) @ _AXES,
    }
)
"""Other pose conventions by description, with functions that convert a recorded pose to deux's convention."""


@dataclass(frozen=True)
class FramePair:
    """A frame with true depth, and a neighbouring frame.

    Args:
        image: the frame, H x W x 3 uint8.
        source: the neighbour, H x W x 3 uint8.
        depth: true depth of the frame, H x W metres, 0 = no value.
        intrinsics: camera matrix of the frame, 3 x 3.
        source_intrinsics: camera matrix of the neighbour, 3 x 3.
        pose: camera-to-world pose of the frame, 4 x 4.
        source_pose: camera-to-world pose of the neighbour, 4 x 4.
    """

    image: np.ndarray
    source: np.ndarray
    depth: np.ndarray
    intrinsics: np.ndarray
    source_intrinsics: np.ndarray
    pose: np.ndarray
    source_pose: np.ndarray


class WarpErrors(NamedTuple):
    """Mean absolute colour differences (0-255) between frames and their neighbours, over the pixels with depth.

    Args:
        warped: error with the recorded poses.
        identity: error without motion.
        explanation: another convention or unit with which the frames agree much better; None if there is none.
    """

    warped: float
    identity: float
    explanation: str | None = None

    @property
    def right(self) -> bool:
        """Whether the error is small and no other convention fits better, or the camera moves too little to decide."""
        return self.identity < STILL or (self.warped <= MOST * self.identity and self.explanation is None)


def warp(pair: FramePair, pose: np.ndarray, source_pose: np.ndarray, stretch: float = 1.0) -> np.ndarray:
    """Reconstruct a frame from its neighbour, H x W x 3 float32, 0-255; NaN at pixels without depth or out of view.

    Args:
        pair: the frames.
        pose: camera-to-world pose of the frame, 4 x 4.
        source_pose: camera-to-world pose of the neighbour, 4 x 4.
        stretch: factor by which depth is multiplied.
    """
    motion = absorb_intrinsics(source_from_target(pose, source_pose), pair.intrinsics, pair.source_intrinsics)
    images, visible = reproject(
        torch.from_numpy(pair.source).permute(2, 0, 1)[None, None].float(),
        torch.from_numpy(np.ascontiguousarray(pair.depth, np.float32) * np.float32(stretch))[None, None],
        torch.from_numpy(pair.intrinsics).float()[None],
        torch.from_numpy(motion).float()[None, None],
    )
    return torch.where(visible, images, torch.nan)[0, 0].permute(1, 2, 0).numpy()


def warp_errors(pairs: Sequence[FramePair], scale: float | None = None) -> WarpErrors:
    """The warp error of the true depth over several pairs of frames, and an explanation if it is large.

    Args:
        pairs: the pairs of frames, at least one.
        scale: stored values per metre with which the depth was read; None if unknown.
    """
    still = np.eye(4)
    identity = _error(pairs, [warp(pair, still, still) for pair in pairs])
    warped = _error(pairs, [warp(pair, pair.pose, pair.source_pose) for pair in pairs])
    if identity < STILL:
        return WarpErrors(warped, identity)
    return WarpErrors(warped, identity, _explanation(pairs, min(CLEARLY * warped, MOST * identity), scale))


def _explanation(pairs: Sequence[FramePair], most: float, scale: float | None) -> str | None:
    """The convention or unit with the smallest error, if that is at most `most`."""
    errors = {
        name: _error(pairs, [warp(pair, change(pair.pose), change(pair.source_pose)) for pair in pairs])
        for name, change in CONVENTIONS.items()
    }
    for other, unit in COMMON_SCALES.items() if scale else ():
        stretch = scale / other  # type: ignore[operator]
        if stretch != 1.0:
            warped = [warp(pair, pair.pose, pair.source_pose, stretch) for pair in pairs]
            errors[f"the depth holds {other:g} values per metre ({unit})"] = _error(pairs, warped)
    best = min(errors, key=lambda name: errors[name])
    return f"{best} (error {errors[best]:.1f})" if errors[best] <= most else None


def _error(pairs: Sequence[FramePair], warped: Sequence[np.ndarray]) -> float:
    """Mean absolute difference over all channels of the visible pixels; infinite if there are none."""
    differences = [np.abs(rebuilt - pair.image) for pair, rebuilt in zip(pairs, warped, strict=True)]
    seen = np.concatenate([difference[np.isfinite(difference)] for difference in differences])
    return float(seen.mean(dtype=np.float64)) if seen.size else np.inf
