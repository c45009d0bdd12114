"""Depth completion of batches of recorded frames, with or without confidence."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from deux.contracts import DepthModel, FrameReference, Uncertainty
from deux.data.frame_stream import RecordedFrame
from deux.deployment.array_prediction import check_prediction, predict_batch
from deux.errors import DeuxError
from deux.frame_uncertainty import check_not_negative, make_view, pixel_uncertainty
from deux.geometry.depth_correction import correct_depth
from deux.inference.precision import default_device, tf32_convolutions
from deux.registry import registry

NamedFrame = tuple[FrameReference, RecordedFrame]
"""A reference to a frame, and the frame."""


@dataclass(frozen=True)
class CompletedDepth:
    """The result of depth completion for a frame.

    Args:
        depth: H x W float32 metres.
        confidence: H x W float32, exp(-uncertainty) in (0, 1], 0 where the measure has no value; None without measure.
    """

    depth: np.ndarray
    confidence: np.ndarray | None = None


class DepthCompleter:
    """Completes the depth of frames in float32, on a CUDA device where there is one.

    Args:
        model: the depth model; it is moved to the device.
        measure: uncertainty measure of the model's depth; None for no confidence.
        corrected: whether the depth is corrected by the sparse points (`deux.geometry.depth_correction`).
    """

    def __init__(self, model: DepthModel, measure: Uncertainty | None = None, corrected: bool = False) -> None:
        self._device = default_device()
        self._model = model.to(self._device)
        self._measure, self._corrected = measure, corrected

    @tf32_convolutions(False)
    def __call__(self, frames: Sequence[RecordedFrame]) -> list[CompletedDepth]:
        """Complete frames that have the same size and number of source frames."""
        sources = len(frames[0].sources)
        if self._measure is None or (self._measure.needs_sources and sources == 0):
            images, points, cameras = (
                np.stack([getattr(frame, name) for frame in frames]) for name in ("image", "sparse_depth", "intrinsics")
            )
            depths = predict_batch(images, points, cameras, self._model, self._corrected)
            return [self._without_confidence(depth) for depth in depths]
        return self._with_confidence(frames, self._measure)

    @torch.no_grad()
    def _with_confidence(self, frames: Sequence[RecordedFrame], measure: Uncertainty) -> list[CompletedDepth]:
        height, width = frames[0].image.shape[:2]
        sources = [source for frame in frames for source in frame.sources]
        shape = (len(frames), len(sources) // len(frames))
        images = self._images([frame.image for frame in frames], height, width)
        view = make_view(
            images,
            self._tensor([frame.sparse_depth for frame in frames])[:, None],
            self._tensor([frame.intrinsics for frame in frames]),
            self._images([source.image for source in sources], height, width).unflatten(0, shape),
            self._tensor([source.source_from_target for source in sources]).reshape(*shape, 4, 4),
            self._model.predict,
        )
        confidences = torch.exp(-pixel_uncertainty(measure, view)).nan_to_num(nan=0.0).cpu().numpy()
        check_not_negative(measure, 1.0 - confidences)
        depth = correct_depth(view.depth, view.sparse_depth) if self._corrected else view.depth
        depths = check_prediction(depth[:, 0].cpu().numpy())
        return [CompletedDepth(depth, confidence) for depth, confidence in zip(depths, confidences, strict=True)]

    def _without_confidence(self, depth: np.ndarray) -> CompletedDepth:
        return CompletedDepth(depth, None if self._measure is None else np.zeros_like(depth))

    def _images(self, images: Sequence[np.ndarray], height: int, width: int) -> Tensor:
        """N x 3 x H x W in [0, 1]; N may be 0."""
        stacked = np.stack(images) if images else np.empty((0, height, width, 3), np.uint8)
        return torch.from_numpy(stacked).to(self._device).permute(0, 3, 1, 2).contiguous().float() / 255.0

    def _tensor(self, arrays: Sequence[np.ndarray]) -> Tensor:
        return torch.from_numpy(np.array(arrays, dtype=np.float32)).to(self._device)


def batches(frames: Iterable[NamedFrame], size: int) -> Iterator[list[NamedFrame]]:
    """Batches of up to `size` consecutive frames with the same image size and number of source frames."""
    batch: list[NamedFrame] = []
    for name, frame in frames:
        if batch and _batch_shape(batch[0][1]) != _batch_shape(frame):
            yield batch
            batch = []
        batch.append((name, frame))
        if len(batch) == size:
            yield batch
            batch = []
    if batch:
        yield batch


def _batch_shape(frame: RecordedFrame) -> tuple[tuple[int, ...], int]:
    return frame.image.shape, len(frame.sources)


def unusable_measure(name: str, reason: str) -> DeuxError:
    """The error for an uncertainty measure that needs source frames where there are none.

    Args:
        name: name of the measure.
        reason: what is missing; a clause of the sentence.
    """
    others = " or ".join(other for other in registry().names("uncertainties") if _uses_single_frames(other))
    return DeuxError(
        f"predict.uncertainty={name} compares a frame with its neighbours by their poses, and {reason}: choose a "
        f"measure of single frames{f', {others}' if others else ''}."
    )


def _uses_single_frames(name: str) -> bool:
    try:
        return not registry().get("uncertainties", name).needs_sources  # type: ignore[attr-defined]
    except DeuxError:  # the plugin cannot be loaded
        return False
