"""Whether the frames that a model is given look right: units, sizes, and the ground truth that is compared with."""

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

MANY = 0.1
"""From this part of the points on, it is said that they lie where the model predicts no depth."""

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class DepthFiles:
    """The user's depth files, for messages.

    Args:
        sparse: where the points were read.
        scale: stored values per metre of its PNG files.
        ground_truth: where the ground truth was read; None without.
    """

    sparse: str
    scale: float
    ground_truth: str | None = None


def check_units(frame: RecordedFrame, model: DepthModel, files: DepthFiles) -> None:
    """Say so if there are no points, or if their values or those of the ground truth look like another unit's.

    Raises:
        DeuxError: all points lie outside the range of depths that the model predicts.
    """
    points = frame.sparse_depth[frame.sparse_depth > 0]
    if not points.size:
        log.warning(f"{files.sparse} holds no point, all its values are 0: the depth comes from the image alone.")
        return
    outside = float(np.mean((points < model.min_depth) | (points > model.max_depth)))
    found = [_other_unit(points, model, files) if outside < MANY else _range_warning(points, outside, model, files)]
    if outside == 1:
        raise DeuxError(str(found[0]))
    if frame.ground_truth is not None:
        what = str(files.ground_truth)
        found.append(
            ratio_warning(frame.ground_truth, frame.sparse_depth, what, scale_sentence("predict.ground_truth_scale"))
        )
    for sentence in found:
        if sentence is not None:
            log.warning(sentence)


def _other_unit(points: np.ndarray, model: DepthModel, files: DepthFiles) -> str | None:
    """The sentence for points of a PNG file within the model's range that are likely to be in another unit."""
    if files.sparse.lower().endswith(ARRAY_SUFFIX):
        return None
    return unit_warning(points, files.scale, model.max_depth, files.sparse, "predict.sparse_scale")


def _range_warning(points: np.ndarray, outside: float, model: DepthModel, files: DepthFiles) -> str:
    """The sentence for points of which the part `outside` lies where the model predicts no depth."""
    share = "all" if outside == 1 else f"{outside:.0%} of the"
    return (
        f"{share} {points.size:,} points of {files.sparse} lie outside the {model.min_depth:g} to {model.max_depth:g} "
        f"m that the model predicts (they go from {points.min():g} to {points.max():g} m): is their unit right? A PNG "
        f"file holds predict.sparse_scale={files.scale:g} values per metre; it is 1000 for millimetres."
    )


def unseen_truth(frame: RecordedFrame, camera: Camera) -> np.ndarray | None:
    """The ground truth that is compared with: within the camera's range, and not given to the model as sparse points.

    Returns:
        H x W float32 metres, 0 = none; None if no pixel is left, or there is no ground truth.
    """
    truth = frame.ground_truth
    if truth is None:
        return None
    counted = (truth > camera.min_depth) & (truth < camera.max_depth) & (frame.sparse_depth == 0)
    return np.where(counted, truth, np.float32(0)) if counted.any() else None


def errors_beside_interpolation(
    depth: np.ndarray, frame: RecordedFrame, truth: np.ndarray, camera: Camera
) -> tuple[dict[str, float], dict[str, float]]:
    """The four errors of a prediction and of the interpolated points; none of the latter without points.

    Args:
        depth: H x W metres, predicted.
        frame: whose depth it is.
        truth: what `unseen_truth` returns.
        camera: gives the range of depths that counts.
    """
    own = _errors(depth, truth, camera)
    return own, _errors(interpolate(frame.sparse_depth), truth, camera) if frame.sparse_depth.any() else {}


def _errors(depth: np.ndarray, truth: np.ndarray, camera: Camera) -> dict[str, float]:
    """The four errors of H x W metres."""
    predicted, known = (torch.from_numpy(values)[None, None] for values in (depth, truth))
    errors = depth_errors(predicted, known, camera.min_depth, camera.max_depth)
    return {name: value.item() for name, value in errors.items()}
