"""Checks of the depth unit: whether the values of depth maps fit the configured number of stored values per metre.

A 16-bit depth map does not record its unit. VOID and KITTI store metres x 256, most cameras millimetres and the TUM
benchmark metres x 5000. With the wrong unit the depth often stays within the depth range of a model, so that nothing
fails and all errors are wrong by the ratio of the units.
"""

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np

COMMON_SCALES: Mapping[float, str] = MappingProxyType({256.0: "metres x 256", 1000.0: "millimetres", 5000.0: "TUM's"})
"""The common numbers of stored values per metre, and their names in messages."""

NEAREST_SCENE = 0.25
"""Smallest plausible median depth in metres, for a robot or a hand-held camera."""

FARTHEST_SCENE = 0.5
"""Largest plausible median depth, as a fraction of the model's largest depth."""

LARGEST_RATIO = 1.25
"""Largest ratio of ground truth to sparse depth at the same pixels, or its inverse, that noise can explain."""


def likely_scale(depth: np.ndarray, scale: float, max_depth: float) -> float | None:
    """Find the common scale that makes the median depth plausible, if the given one does not.

    Args:
        depth: metres as read with `scale`, of any shape, 0 = none.
        scale: stored values per metre.
        max_depth: largest depth in metres that the model predicts.

    Returns:
        Stored values per metre; None if the depth is plausible with `scale` or with no common scale.
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
    """The warning for depth that is probably in another unit; None if its values are plausible.

    Args:
        depth: see `likely_scale`.
        scale: see `likely_scale`.
        max_depth: see `likely_scale`.
        what: the name of the depth in the message, such as its file.
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
    """Stored values per metre of a reader's sparse depth, and the option that sets them; None without such an option.

    Readers whose sparse depth may have a different unit have the option `sparse_scale`, which takes precedence over
    `scale`.
    """
    for option in ("sparse_scale", "scale"):
        if (scale := getattr(reader, option, None)) is not None:
            return scale, f"data.{option}"
    return None


def ratio_remedy(reader: object) -> str:
    """The sentence on the reader's option that sets the unit of the ground truth or the points; "" without one."""
    options = {"ground_truth_scale": "the ground truth", "sparse_scale": "the sparse points"}
    return next((scale_sentence(f"data.{name}", of) for name, of in options.items() if hasattr(reader, name)), "")


def scale_sentence(option: str, of: str = "the ground truth") -> str:
    """The sentence on what an option sets, with a leading space."""
    return f" {option} sets the stored values per metre of {of}."


def ratio_warning(truth: np.ndarray, sparse_depth: np.ndarray, what: str, remedy: str) -> str | None:
    """The warning for ground truth in another unit than the sparse depth; None if they agree.

    Args:
        truth: metres, 0 = none.
        sparse_depth: metres, 0 = none, of the same shape.
        what: the name of the ground truth in the message, such as its file.
        remedy: a sentence with a leading space on what sets the scale; "" for none.
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
