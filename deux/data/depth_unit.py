"""Whether depth was read in the right unit: what its values say about the number of stored values per metre.

A 16-bit depth map does not say its unit. VOID and KITTI store metres x 256, most cameras millimetres and the TUM
benchmark metres x 5000. Read in the wrong unit a scene stays within the range of depths that a model predicts, so that
nothing fails: errors are then wrong by the ratio of the units.
"""

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np

COMMON_SCALES: Mapping[float, str] = MappingProxyType({256.0: "metres x 256", 1000.0: "millimetres", 5000.0: "TUM's"})
"""The usual numbers of stored values per metre, and how they are called."""

NEAREST_SCENE = 0.25
"""Metres: a median depth below it is that of no scene of which a robot or a hand-held camera takes depth."""

FARTHEST_SCENE = 0.5
"""Part of a model's largest depth: in the scenes that it is made for the median depth lies below it."""

LARGEST_RATIO = 1.25
"""Ratio of ground truth and sparse points of the same pixels, or its inverse, that noise does not explain."""


def likely_scale(depth: np.ndarray, scale: float, max_depth: float) -> float | None:
    """Another usual scale that fits the values better, judged by their median.

    Args:
        depth: metres as read with `scale`, of any shape, 0 = none.
        scale: stored values per metre.
        max_depth: largest depth in metres that the model predicts.

    Returns:
        Stored values per metre; None where the values are plausible as they are, or no usual scale makes them so.
    """
    points = depth[depth > 0]
    if not points.size:
        return None
    median, least, most = float(np.median(points)), NEAREST_SCENE, FARTHEST_SCENE * max_depth
    if least <= median <= most:
        return None
    fitting = [other for other in COMMON_SCALES if least <= median * scale / other <= most]
    return min(fitting, key=lambda other: abs(np.log(other / scale)), default=None)


def unit_warning(depth: np.ndarray, scale: float, max_depth: float, what: str, option: str) -> str | None:
    """The sentence for depth whose values make another unit likely; None where there is nothing to say.

    Args:
        depth: as of `likely_scale`.
        scale: as of `likely_scale`.
        max_depth: as of `likely_scale`.
        what: what the depth is called, such as its file.
        option: the option that sets the scale, such as "data.scale".
    """
    other = likely_scale(depth, scale, max_depth)
    if other is None:
        return None
    median = float(np.median(depth[depth > 0]))
    outdoors = f", or max_depth={max_depth:g} too small" if median > max_depth else ""
    return (
        f"the median depth of {what} is {median:.2f} m with {option}={scale:g} and would be "
        f"{median * scale / other:.2f} m with {option}={other:g} ({COMMON_SCALES[other]}): is the unit "
        f"right{outdoors}?"
    )


def points_scale(reader: object) -> tuple[float, str] | None:
    """Stored values per metre of a reader's points, and the option that sets them; None where it has no such option.

    Readers of points with a unit of their own have an option `sparse_scale`, which takes the place of `scale`.
    """
    for option in ("sparse_scale", "scale"):
        if (scale := getattr(reader, option, None)) is not None:
            return scale, f"data.{option}"
    return None


def ratio_remedy(reader: object) -> str:
    """Which option of a reader brings its ground truth and its points into one unit; "" where it has none."""
    options = {"ground_truth_scale": "the ground truth", "sparse_scale": "the sparse points"}
    return next((scale_sentence(f"data.{name}", of) for name, of in options.items() if hasattr(reader, name)), "")


def scale_sentence(option: str, of: str = "the ground truth") -> str:
    """The sentence, after a blank, on what an option sets."""
    return f" {option} sets the stored values per metre of {of}."


def ratio_warning(truth: np.ndarray, sparse_depth: np.ndarray, what: str, remedy: str) -> str | None:
    """The sentence for ground truth that is in another unit than the sparse points; None where they agree.

    Args:
        truth: metres, 0 = none.
        sparse_depth: metres, 0 = none, of the same shape.
        what: what the ground truth is called, such as its file.
        remedy: a sentence after a blank that says what sets its scale; "" for none.
    """
    both = (truth > 0) & (sparse_depth > 0)
    if not both.any():
        return None
    ratio = float(np.median(truth[both] / sparse_depth[both]))
    if 1 / LARGEST_RATIO <= ratio <= LARGEST_RATIO:
        return None
    return (
        f"{what} is {ratio:.3g} times the sparse depth at the points that both have (median): are both in one unit?"
        f"{remedy}"
    )
