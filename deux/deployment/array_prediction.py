"""Depth from arrays, as cameras and files give them: what `deux.predict` does."""

from os import PathLike

import numpy as np
import torch
from numpy.typing import ArrayLike

from deux.contracts import DepthModel
from deux.deployment.model_files import load_model
from deux.errors import DeuxError

OTHER_UNIT = 10.0
"""If even the nearest point lies this many times beyond the model's range, the points are not in metres."""


def predict_arrays(
    image: ArrayLike, sparse_depth: ArrayLike, intrinsics: ArrayLike, model: DepthModel | str | PathLike[str]
) -> np.ndarray:
    """Predict dense depth of one frame, or of N frames, in float32 and on the model's own device.

    Args:
        image: H x W x 3 or N x H x W x 3, RGB: uint8, or floats in [0, 1]. Any size.
        sparse_depth: H x W or N x H x W metres, floats, 0 = none.
        intrinsics: 3 x 3, [[fx, s, cx], [0, fy, cy], [0, 0, 1]] in pixels of this image; or N x 3 x 3.
        model: a depth model, or the path of a run folder or model file. For many frames load it once, by `deux.load`.

    Returns:
        H x W or N x H x W float32 metres.

    Raises:
        DeuxError: an input has another shape or type, or impossible values; or there is no such model.

    Example:
        >>> model = deux.load("outputs/runs/kbnet-deux-1a2b3c4d")
        >>> depth = deux.predict(image, sparse_depth, intrinsics, model=model)
        >>> depth.shape == sparse_depth.shape
        True
    """
    model = model if isinstance(model, DepthModel) else _loaded(model)
    colors, points, cameras = _image(image), _sparse_depth(sparse_depth), _intrinsics(intrinsics)
    _check_shapes(colors, points, cameras)
    _check_unit(points, model.max_depth)
    single = colors.ndim == 3
    if single:
        colors, points = colors[None], points[None]
    cameras = np.broadcast_to(cameras, (len(colors), 3, 3)).copy()
    with torch.autocast(_device(model).type, enabled=False):
        depth = model.predict(
            torch.from_numpy(colors).permute(0, 3, 1, 2).contiguous(),
            torch.from_numpy(points)[:, None],
            torch.from_numpy(cameras),
        )
    dense = depth[:, 0].cpu().numpy()
    return dense[0] if single else dense


def _loaded(model: str | PathLike[str]) -> DepthModel:
    if not isinstance(model, str | PathLike):
        raise DeuxError(
            f"model is of the type {type(model).__name__}: it is a depth model, or the path of a run folder or model "
            "file."
        )
    return load_model(model)


def _device(model: DepthModel) -> torch.device:
    return next((parameter.device for parameter in model.parameters()), torch.device("cpu"))


def _array(name: str, value: ArrayLike) -> np.ndarray:
    """The value as an array of numbers."""
    try:
        array = np.asarray(value)
    except (TypeError, ValueError, RuntimeError) as error:
        reason = " ".join(str(error).split()).rstrip(".")
        raise DeuxError(f"{name} cannot be made an array ({reason}): it is a numpy array.") from error
    if array.dtype.kind not in "biuf":
        raise DeuxError(f"{name} is of the type {array.dtype}: it is an array of numbers.")
    return array


def _image(value: ArrayLike) -> np.ndarray:
    """The image as floats in [0, 1]; float values are checked where the tensors are."""
    image = _array("image", value)
    if image.dtype == np.uint8:
        return image.astype(np.float32) / np.float32(255.0)
    if image.dtype.kind != "f":
        raise DeuxError(f"image is of the type {image.dtype}: it is uint8, or floating point in [0, 1].")
    return _float32(image)


def _sparse_depth(value: ArrayLike) -> np.ndarray:
    depth = _array("sparse_depth", value)
    if depth.dtype.kind != "f":
        raise DeuxError(
            f"sparse_depth is of the type {depth.dtype}: it is metres in floating point, so divide millimetres by "
            "1000.0 and the values of a 16-bit PNG in metres x 256 by 256.0."
        )
    return _float32(depth)


def _intrinsics(value: ArrayLike) -> np.ndarray:
    return _float32(_array("intrinsics", value))


def _float32(array: np.ndarray) -> np.ndarray:
    """A copy that torch may own: rows in order, writable. What float32 cannot hold becomes infinite."""
    with np.errstate(over="ignore"):
        return np.array(array, dtype=np.float32, order="C")


def _check_shapes(image: np.ndarray, sparse_depth: np.ndarray, intrinsics: np.ndarray) -> None:
    if image.ndim not in (3, 4) or image.shape[-1] != 3 or image.size == 0:
        raise DeuxError(
            f"image has the shape {_shape(image)}: it is H x W x 3 (red, green, blue), or N x H x W x 3 for N frames."
        )
    if sparse_depth.shape != image.shape[:-1]:
        raise DeuxError(
            f"sparse_depth has the shape {_shape(sparse_depth)}: for an image of {_shape(image)} it is "
            f"{' x '.join(map(str, image.shape[:-1]))}."
        )
    batched = image.ndim == 4 and intrinsics.shape == (len(image), 3, 3)
    if intrinsics.shape != (3, 3) and not batched:
        wanted = f"3 x 3, or {len(image)} x 3 x 3" if image.ndim == 4 else "3 x 3"
        raise DeuxError(
            f"intrinsics has the shape {_shape(intrinsics)}: for an image of {_shape(image)} it is {wanted}."
        )


def _check_unit(sparse_depth: np.ndarray, max_depth: float) -> None:
    """Raise DeuxError if the points can be no metres; frames that are merely far away are let through."""
    points = sparse_depth[sparse_depth > 0]
    if points.size and OTHER_UNIT * max_depth < points.min() < np.inf:
        raise DeuxError(
            f"the nearest point of sparse_depth is at {points.min():g} and the model predicts up to {max_depth:g} "
            "metres: sparse_depth is in metres, so divide millimetres by 1000."
        )


def _shape(array: np.ndarray) -> str:
    return " x ".join(map(str, array.shape)) or "a single number"
