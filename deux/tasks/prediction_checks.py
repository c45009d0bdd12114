"""Checks of a model's input (units and depth range), and comparison of its output with ground truth."""

import logging
from dataclasses import dataclass

import numpy as np
import torch

from deux.contracts import DepthModel
from deux.data.depth_unit import ratio_warning, scale_sentence, unit_warning
from deux.data.frame_stream import RecordedFrame
from deux.errors import DeuxError
from deux.geometry.camera import Camera
from deux.geometry.scaffolding import interpolate
from deux.io.camera_files import ARRAY_SUFFIX
from deux.metrics.depth_errors import depth_errors

OUT_OF_RANGE_FRACTION = 0.1
"""Fraction of the points out of the model's depth range from which a warning is logged."""

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class DepthFiles:
    """Paths of the user's depth files, for messages.

    Args:
        sparse: file or folder of the sparse points.
        scale: stored values per metre in its PNG files.
        ground_truth: file or folder of the ground truth; None if there is none.
    """

    sparse: str
    scale: float
    ground_truth: str | None = None


def check_units(frame: RecordedFrame, model: DepthModel, files: DepthFiles) -> None:
    """Warn if there are no sparse points, or if points or ground truth seem to be in a wrong unit.

    Raises:
        DeuxError: all points are out of the model's depth range.
    """
    points = frame.sparse_depth[frame.sparse_depth > 0]
    if not points.size:
        log.warning(f"{files.sparse} has no sparse point, all its values are 0: only the image is used.")
        return
    outside = float(np.mean((points < model.min_depth) | (points > model.max_depth)))
    if outside == 1:
        raise DeuxError(_range_warning(points, outside, model, files))
    in_range = outside < OUT_OF_RANGE_FRACTION
    warnings = [_unit_warning(points, model, files) if in_range else _range_warning(points, outside, model, files)]
    if frame.ground_truth is not None:
        remedy = scale_sentence("predict.ground_truth_scale")
        warnings.append(ratio_warning(frame.ground_truth, frame.sparse_depth, str(files.ground_truth), remedy))
    for warning in filter(None, warnings):
        log.warning(warning)


def _unit_warning(points: np.ndarray, model: DepthModel, files: DepthFiles) -> str | None:
    """The warning about points of PNG files that seem to be in a wrong unit; None if they do not."""
    if files.sparse.lower().endswith(ARRAY_SUFFIX):
        return None
    return unit_warning(points, files.scale, model.max_depth, files.sparse, "predict.sparse_scale")


def _range_warning(points: np.ndarray, outside: float, model: DepthModel, files: DepthFiles) -> str:
    """The message about points of which the fraction `outside` is out of the model's depth range."""
    share = "all" if outside == 1 else f"{outside:.0%} of the"
    return (
        f"{share} {points.size:,} points of {files.sparse} are out of the model's depth range of {model.min_depth:g} "
        f"to {model.max_depth:g} m (they range from {points.min():g} to {points.max():g} m): check their unit; PNG "
        f"files have predict.sparse_scale={files.scale:g} values per metre, which is 1000 for millimetres."
    )


def unseen_truth(frame: RecordedFrame, camera: Camera) -> np.ndarray | None:
    """The ground truth to compare with: within the camera's depth range, without the sparse points.

    Returns:
        H x W float32 metres, 0 = no value; None if there is no ground truth, or no pixel of it remains.
    """
    truth = frame.ground_truth
    if truth is None:
        return None
    valid = (truth > camera.min_depth) & (truth < camera.max_depth) & (frame.sparse_depth == 0)
    return np.where(valid, truth, np.float32(0)) if valid.any() else None


def errors_beside_interpolation(
    depth: np.ndarray, frame: RecordedFrame, truth: np.ndarray, camera: Camera
) -> tuple[dict[str, float], dict[str, float]]:
    """The four depth errors of a prediction, and those of interpolating the sparse points; the latter may be empty.

    Args:
        depth: predicted depth, H x W metres.
        frame: the frame, whose sparse points are interpolated if there are any.
        truth: the result of `unseen_truth`.
        camera: its depth range is evaluated.
    """
    errors = _errors(depth, truth, camera)
    return errors, _errors(interpolate(frame.sparse_depth), truth, camera) if frame.sparse_depth.any() else {}


def _errors(depth: np.ndarray, truth: np.ndarray, camera: Camera) -> dict[str, float]:
    """The four errors of a depth map, H x W metres."""
    predicted, target = (torch.from_numpy(values)[None, None] for values in (depth, truth))
    errors = depth_errors(predicted, target, camera.min_depth, camera.max_depth)
    return {name: value.item() for name, value in errors.items()}
