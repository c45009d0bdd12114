"""Whether depth, poses and intrinsics of recorded frames belong together: the warp error of the true depth.

A frame is rebuilt from its neighbour with its own true depth and the recorded poses (Eq. 1). If all of them are right
the colours agree better than without any motion; a pose convention or a unit that is not the reader's shows at once.
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
"""Part of the identity's error that the warp error of a recording may have."""

CLEARLY = 0.75
"""Part of the warp error that another convention must reach to be named: with a turning camera the inverted poses come
near the right ones, since their rotations agree."""

STILL = 2.0
"""Mean colour difference (0-255) of neighbouring frames below which the camera moves too little to judge by."""

_AXES = np.diag([1.0, -1.0, -1.0, 1.0])

CONVENTIONS: Mapping[str, Callable[[np.ndarray], np.ndarray]] = MappingProxyType(
    {
        "the poses are world-to-camera": inverse,
        "the camera's axes are OpenGL's (x right, y up, z backward)": lambda pose: pose @ _AXES,
        "the poses are world-to-camera with OpenGL's axes": lambda pose: inverse(pose) @ _AXES,
    }
)
"""Other conventions by what they are called, as functions from a recorded pose to the reader's."""


@dataclass(frozen=True)
class FramePair:
    """A frame with true depth and a neighbour of it.

    Args:
        image: H x W x 3 uint8.
        source: H x W x 3 uint8, the neighbour.
        depth: H x W metres, of the frame; 0 = none.
        intrinsics: 3 x 3, of the frame.
        source_intrinsics: 3 x 3, of the neighbour.
        pose: 4 x 4, camera-to-world, of the frame.
        source_pose: 4 x 4, of the neighbour.
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
        warped: with the recorded poses.
        identity: without any motion.
        explanation: another convention or unit under which the frames agree, clearly better than under the reader's;
            None if none is known.
    """

    warped: float
    identity: float
    explanation: str | None = None

    @property
    def right(self) -> bool:
        """Whether the error is small and no other convention's is smaller, or the camera moves too little to tell."""
        return self.identity < STILL or (self.warped <= MOST * self.identity and self.explanation is None)


def warp(pair: FramePair, pose: np.ndarray, source_pose: np.ndarray, stretch: float = 1.0) -> np.ndarray:
    """The frame as its neighbour shows it, H x W x 3 float32, 0-255; NaN at pixels without depth or out of view.

    Args:
        pair: the frames.
        pose: 4 x 4, camera-to-world, of the frame.
        source_pose: 4 x 4, of the neighbour.
        stretch: factor of the depth.
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
    """The warp error of the true depth over several pairs of frames, and what else explains them if it is large.

    Args:
        pairs: at least one.
        scale: stored values per metre with which the depth was read; None where that is not known.
    """
    still = np.eye(4)
    identity = _error(pairs, [warp(pair, still, still) for pair in pairs])
    warped = _error(pairs, [warp(pair, pair.pose, pair.source_pose) for pair in pairs])
    if identity < STILL:
        return WarpErrors(warped, identity)
    return WarpErrors(warped, identity, _explanation(pairs, min(CLEARLY * warped, MOST * identity), scale))


def _explanation(pairs: Sequence[FramePair], most: float, scale: float | None) -> str | None:
    """The convention or unit with the least error, if it is at most `most`."""
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
    """Mean absolute difference over all channels of the pixels that are seen; infinite if there are none."""
    differences = [np.abs(rebuilt - pair.image) for pair, rebuilt in zip(pairs, warped, strict=True)]
    seen = np.concatenate([difference[np.isfinite(difference)] for difference in differences])
    return float(seen.mean(dtype=np.float64)) if seen.size else np.inf
