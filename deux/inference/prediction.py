"""Depth from one batch of camera data: what `deux.contracts.DepthModel.predict` does."""

import math
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any, ClassVar, Protocol

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional

from deux.broken_contracts import broken_contract
from deux.errors import DeuxError, kind_of, sizes
from deux.geometry.camera import FOCAL_LENGTHS, is_focal_length
from deux.geometry.sparse_outliers import remove_outliers
from deux.memory_budget import check_memory

PIXEL_BYTES = 1000
"""Memory for each pixel of a prediction: a network's features have some hundred channels of 4 bytes at full size."""

LARGE = 4_000_000
"""Pixels up to which the memory for a prediction is not looked at."""

TOLERANCE = 1e-3
"""How far image values may lie outside [0, 1]: resampling overshoots a little."""


class CompletionNetwork(Protocol):
    """What prediction asks of a depth model; `deux.contracts.DepthModel` describes it."""

    size_multiple: ClassVar[int]

    @property
    def prepares(self) -> bool:
        """Whether `prepare` returns anything."""

    def __call__(
        self, image: Tensor, sparse_depth: Tensor, validity: Tensor, intrinsics: Tensor, **prepared: Tensor
    ) -> Any:
        """The network's output, whose `depth` is N x 1 x H x W metres."""

    def prepare(self, sparse_depth: np.ndarray) -> dict[str, np.ndarray]:
        """Further inputs of one sample."""

    def parameters(self) -> Iterator[nn.Parameter]:
        """Whose device the prediction runs on."""

    def modules(self) -> Iterator[nn.Module]:
        """The network and its parts."""

    def eval(self) -> Any:
        """Put all parts into eval mode."""

    def to(self, device: torch.device, /) -> Any:
        """Move the network to a device and return it."""

    def predict(self, image: Tensor, sparse_depth: Tensor, intrinsics: Tensor) -> Tensor:
        """As the function `predict`, with this network."""


def device_of(model: CompletionNetwork) -> torch.device:
    """The device that a model's inputs go to: its weights', or the CPU if it has none."""
    return next((weight.device for weight in model.parameters()), torch.device("cpu"))


@torch.no_grad()
def predict(
    model: CompletionNetwork,
    image: Tensor | np.ndarray,
    sparse_depth: Tensor | np.ndarray,
    intrinsics: Tensor | np.ndarray,
) -> Tensor:
    """Predict dense depth, with all that the model needs before its network.

    Outliers among the sparse points are found, the model's further inputs are prepared, the images are padded to its
    `size_multiple` and the result is cropped. The model runs in eval mode and is put back into the mode it was in.
    The host waits for the device once, for the check of the inputs, and a second time if the model prepares some.

    Args:
        model: the depth model.
        image: N x 3 x H x W in [0, 1].
        sparse_depth: N x 1 x H x W metres, 0 = none.
        intrinsics: N x 3 x 3 camera matrices of these images, [[fx, s, cx], [0, fy, cy], [0, 0, 1]].

    Returns:
        N x 1 x H x W float32 metres, on the model's device.

    Raises:
        DeuxError: an input has another shape or impossible values, or the model fails as its weights are not float32.
    """
    device = device_of(model)
    image, sparse_depth, intrinsics = (
        _tensor(name, value).to(device, torch.float32)
        for name, value in (("image", image), ("sparse_depth", sparse_depth), ("intrinsics", intrinsics))
    )
    _check(image, sparse_depth, intrinsics)
    _check_size(image)
    prepared = prepared_inputs(model, sparse_depth)
    with eval_mode(model), _weights_told(model):
        return complete(model, image, sparse_depth, intrinsics, prepared)


def complete(
    model: CompletionNetwork, image: Tensor, sparse_depth: Tensor, intrinsics: Tensor, prepared: Mapping[str, Tensor]
) -> Tensor:
    """The part of `predict` that consists of tensor operations alone; what an exported model holds.

    Args:
        model: the depth model, run in the mode that it is in.
        image: N x 3 x H x W in [0, 1].
        sparse_depth: N x 1 x H x W metres, 0 = none.
        intrinsics: N x 3 x 3.
        prepared: the model's further inputs, N x C x H x W.

    Returns:
        N x 1 x H x W float32 metres.

    Raises:
        DeuxError: the model gives something else than depth of the images' size.
    """
    validity = remove_outliers(sparse_depth)
    height, width = image.shape[2:]
    pad_to = (-width % model.size_multiple, -height % model.size_multiple)
    padded = _pad(image, pad_to)
    prediction = model(
        padded,
        _pad(sparse_depth, pad_to),
        _pad(validity, pad_to),
        intrinsics,
        **{name: _pad(value, pad_to) for name, value in prepared.items()},
    )
    return _depth_of(model, prediction, padded)[:, :, :height, :width].float()


def prepared_inputs(model: CompletionNetwork, sparse_depth: Tensor) -> dict[str, Tensor]:
    """What `DepthModel.prepare` makes of each sample of N x 1 x H x W metres, batched, on the same device."""
    if not model.prepares:
        return {}
    samples = [prepare_sample(model.prepare, depth) for depth in sparse_depth[:, 0].cpu().numpy()]
    return {
        name: torch.stack([torch.from_numpy(sample[name]) for sample in samples]).to(sparse_depth.device)
        for name in samples[0]
    }


def prepare_sample(prepare: Callable[[np.ndarray], Any], sparse_depth: np.ndarray) -> dict[str, np.ndarray]:
    """What a model's `prepare` makes of one sample of H x W metres, each C x H x W float32.

    Raises:
        DeuxError: it gives something else.
    """
    model = getattr(prepare, "__self__", prepare)
    wanted = "arrays of C x H x W, float32, by name: {} where there is nothing to prepare"
    prepared = prepare(sparse_depth)
    if not isinstance(prepared, Mapping):
        raise broken_contract(model, kind_of(prepared), wanted, "prepare")
    for key, array in prepared.items():
        fits = isinstance(array, np.ndarray) and array.dtype == np.float32 and array.ndim == 3
        if not fits or array.shape[1:] != sparse_depth.shape:
            raise broken_contract(model, f"{kind_of(array)} as {key!r}", wanted, "prepare")
    return dict(prepared)


def _depth_of(model: CompletionNetwork, prediction: Any, image: Tensor) -> Tensor:
    """The depth in what a model gives for N x 3 x H x W images, whose shape and type alone are looked at."""
    depth, wanted = getattr(prediction, "depth", None), (image.shape[0], 1, *image.shape[2:])
    if isinstance(depth, Tensor) and depth.shape == wanted and depth.is_floating_point():
        return depth
    given = kind_of(prediction) if depth is None else f"a prediction whose depth is {kind_of(depth)}"
    right = f"a deux.contracts.Prediction with a depth of N x 1 x H x W, float32, here {sizes(wanted)}"
    raise broken_contract(model, given, right, "forward")


@contextmanager
def _weights_told(model: CompletionNetwork) -> Iterator[None]:
    """Say of a network whose weights are not float32, and which does not convert its inputs, why it fails inside."""
    try:
        yield
    except RuntimeError as error:
        kinds = {weight.dtype for weight in model.parameters() if weight.is_floating_point()} - {torch.float32}
        if not kinds:
            raise
        raise DeuxError(
            f"the model's weights are of the type {_kind(kinds.pop())}, and it predicts in float32: call model.float() "
            "first."
        ) from error


def _tensor(name: str, value: Any) -> Tensor:
    """The value as a tensor; torch itself takes no array with reversed axes or the other order of bytes."""
    try:
        if isinstance(value, np.ndarray):
            with np.errstate(over="ignore"):  # what float32 cannot hold becomes infinite
                value = np.array(value, dtype=np.float32, order="C")
        return torch.as_tensor(value)
    except (TypeError, ValueError, RuntimeError) as error:
        raise DeuxError(f"{name} is of the type {type(value).__name__}: it is a tensor or array of numbers.") from error


def _check(image: Tensor, sparse_depth: Tensor, intrinsics: Tensor) -> None:
    """Raise DeuxError unless shapes and values are possible; all values that are looked at are read at once."""
    if image.ndim != 4 or image.shape[1] != 3 or 0 in image.shape:
        raise DeuxError(f"image has the shape {_shape(image)}: it is N x 3 x H x W.")
    count, _, height, width = image.shape
    for name, tensor, expected in (
        ("sparse_depth", sparse_depth, (count, 1, height, width)),
        ("intrinsics", intrinsics, (count, 3, 3)),
    ):
        if tensor.shape != expected:
            raise DeuxError(
                f"{name} has the shape {_shape(tensor)}: for this image it is {' x '.join(map(str, expected))}."
            )
    ends = torch.stack([*torch.aminmax(image), *torch.aminmax(sparse_depth)])
    low, high, nearest, farthest, *cameras = torch.cat([ends, intrinsics.flatten()]).tolist()
    if not -TOLERANCE <= low <= high <= 1 + TOLERANCE:
        raise DeuxError(f"image goes from {low:g} to {high:g}: its values lie in [0, 1] (8-bit images / 255).")
    if not 0 <= nearest <= farthest < float("inf"):
        raise DeuxError(
            f"sparse_depth goes from {nearest:g} to {farthest:g}: it is in metres, finite, with 0 for none."
        )
    for i in range(count):
        _check_camera(f"intrinsics[{i}]", cameras[9 * i : 9 * i + 9])


def _check_size(image: Tensor) -> None:
    """Raise DeuxError if images are too large for the memory there is; small ones are not looked at."""
    count, _, height, width = image.shape
    if count * height * width > LARGE and image.device.type == "cpu":
        what = f"the prediction of {count} x {width:,} x {height:,} pixels"
        check_memory(PIXEL_BYTES * count * height * width, what, "make the images smaller or predict fewer at once")


def _check_camera(name: str, numbers: list[float]) -> None:
    """Raise DeuxError unless nine numbers are a camera matrix, row by row, that can be inverted."""
    fx, _, _, shear, fy, _, *last = numbers
    if fx > 0 and fy > 0 and not (is_focal_length(fx) and is_focal_length(fy)):
        raise DeuxError(
            f"{name} has the focal lengths {fx:g} and {fy:g}: they are in pixels, from {FOCAL_LENGTHS[0]:g} to "
            f"{FOCAL_LENGTHS[1]:g}."
        )
    if not (all(map(math.isfinite, numbers)) and fx > 0 and fy > 0 and shear == 0 and last == [0, 0, 1]):
        raise DeuxError(
            f"{name} = {[numbers[:3], numbers[3:6], numbers[6:]]} is singular or no camera matrix: it is [[fx, s, cx], "
            "[0, fy, cy], [0, 0, 1]] in pixels with fx and fy above 0."
        )


def _pad(x: Tensor, amounts: tuple[int, int]) -> Tensor:
    """Add columns at the right and rows at the bottom, where they leave the intrinsics as they are."""
    columns, rows = amounts
    return functional.pad(x, (0, columns, 0, rows)) if columns or rows else x


@contextmanager
def eval_mode(model: CompletionNetwork) -> Iterator[None]:
    """Eval mode for a while; each part gets back its own mode, since some may be frozen in eval mode."""
    training = [module for module in model.modules() if module.training]
    model.eval()
    try:
        yield
    finally:
        for module in training:
            module.training = True


def _kind(dtype: torch.dtype) -> str:
    return str(dtype).removeprefix("torch.")


def _shape(x: Tensor) -> str:
    return " x ".join(map(str, x.shape)) or "a single number"
