"""Frames of a depth video: image, depth and confidence side by side."""

from functools import cache

import cv2
import matplotlib
import numpy as np

from deux.figures.drawing import DEPTH_COLORS, UNCERTAINTY_COLORS

LARGEST_PANEL = 360
"""Maximum height of a panel in pixels; larger frames are downsampled."""

_NONE = 217
"""Grey level of pixels without a value, as in the figures."""


def draw_video_frame(
    image: np.ndarray, depth: np.ndarray, depth_range: tuple[float, float], confidence: np.ndarray | None = None
) -> np.ndarray:
    """Draw one frame.

    Args:
        image: H x W x 3 uint8.
        depth: H x W metres, 0 = none.
        depth_range: limits of the colour scale in metres, the same for the whole video.
        confidence: H x W in [0, 1], 0 = none; None for no third panel.

    Returns:
        h x w x 3 uint8, the panels from left to right; h is H or `LARGEST_PANEL`.
    """
    panels = [image, color_map(depth, depth_range, DEPTH_COLORS)]
    if confidence is not None:
        panels.append(color_map(confidence, (0.0, 1.0), UNCERTAINTY_COLORS))
    picture = np.concatenate(panels, axis=1)
    scale = LARGEST_PANEL / picture.shape[0]
    if scale >= 1.0:
        return picture
    return cv2.resize(picture, (round(picture.shape[1] * scale), LARGEST_PANEL), interpolation=cv2.INTER_AREA)


def color_map(values: np.ndarray, ends: tuple[float, float], colors: str) -> np.ndarray:
    """Apply a colour map to H x W values; returns H x W x 3 uint8, grey where values are not finite or not above 0.

    Args:
        values: H x W.
        ends: limits of the colour scale.
        colors: name of a matplotlib colour map.
    """
    low, high = ends
    known = np.isfinite(values) & (values > 0)
    level = np.clip((np.where(known, values, low) - low) / max(high - low, 1e-6), 0.0, 1.0)
    return np.where(known[..., None], _table(colors)[np.rint(255.0 * level).astype(np.uint8)], np.uint8(_NONE))


@cache
def _table(colors: str) -> np.ndarray:
    """A colour map as a 256 x 3 uint8 table."""
    return np.rint(255.0 * matplotlib.colormaps[colors](np.arange(256))[:, :3]).astype(np.uint8)
