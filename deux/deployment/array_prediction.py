"""Depth prediction from numpy arrays, the implementation of `deux.predict`."""

import logging
from collections.abc import Iterable, Iterator, Sequence
from itertools import zip_longest
from numbers import Integral
from os import PathLike
from typing import Any, NamedTuple, TypeAlias, overload

import numpy as np
import torch
from numpy.typing import ArrayLike

from deux.contracts import DepthModel
from deux.deployment.model_files import load_model
from deux.errors import DeuxError, check_range, sizes
from deux.geometry.depth_correction import correct_depth
from deux.inference.prediction import device_of
from deux.io.calibration import camera_warning

Model: TypeAlias = DepthModel | str | PathLike[str]
"""A depth model, or the path of one."""

_ENDED = object()
"""Fill value for a stream that ended before the others."""

OTHER_UNIT = 10.0
"""Factor by which even the nearest point of a later frame of a stream must exceed the model's depth range to conclude
that the points are not in metres; for the first frame, and without a stream, the factor is 1."""

log = logging.getLogger(__name__)


@overload
def predict_arrays(  # type: ignore[overload-overlap]  # a list of arrays is an array, as for numpy
    image: ArrayLike,
    sparse_depth: ArrayLike,
    intrinsics: ArrayLike,
    model: Model,
    batch_size: int = ...,
    corrected: bool = ...,
) -> np.ndarray: ...


@overload
def predict_arrays(
    image: Iterable[ArrayLike],
    sparse_depth: Iterable[ArrayLike],
    intrinsics: ArrayLike | Iterable[ArrayLike],
    model: Model,
    batch_size: int = ...,
    corrected: bool = ...,
) -> Iterator[np.ndarray]: ...


def predict_arrays(
    image: ArrayLike | Iterable[ArrayLike],
    sparse_depth: ArrayLike | Iterable[ArrayLike],
    intrinsics: ArrayLike | Iterable[ArrayLike],
    model: Model,
    batch_size: int = 1,
    corrected: bool = False,
) -> np.ndarray | Iterator[np.ndarray]:
    """Predict dense depth of one frame, N frames or a stream of frames, in float32 on the model's device.

    In a stream, `image` and `sparse_depth` are iterators or other iterables that are neither arrays nor lists, and
    `intrinsics` may be one. The result is then a generator, which reads frames when they are needed and does not store
    them, so that videos of any length can be processed.

    A warning is logged, once for each call, if the intrinsics seem to belong to images of another size.

    Args:
        image: H x W x 3 or N x H x W x 3, RGB: uint8, or floats in [0, 1]. Or a stream of H x W x 3.
        sparse_depth: H x W or N x H x W metres, floats; 0 and masked values mean no value. Or a stream of H x W.
        intrinsics: 3 x 3, [[fx, s, cx], [0, fy, cy], [0, 0, 1]] in pixels of this image; or N x 3 x 3. One matrix for
            all frames of a stream, or a stream of matrices.
        model: a depth model, or the path of a run folder or model file. For many calls, load it once by `deux.load`.
        batch_size: number of frames of a stream that are predicted at once, if they have the same size.
        corrected: multiply the depth by a smooth field that aligns it with the sparse points
            (`deux.geometry.depth_correction`).

    Returns:
        H x W or N x H x W float32 metres; for a stream, an iterator of H x W.

    Raises:
        DeuxError: an input has a wrong shape, type or value; all points (of the first frame of a stream) are beyond the
            model's depth range; or there is no such model.

    Example:
        >>> model = deux.load("outputs/runs/kbnet-deux-1a2b3c4d")
        >>> depth = deux.predict(image, sparse_depth, intrinsics, model=model)
        >>> depth.shape == sparse_depth.shape
        True
    """
    model = model if isinstance(model, DepthModel) else _loaded(model)
    if _is_stream(image) or _is_stream(sparse_depth):
        check_range("batch_size", batch_size, 1)
        if not isinstance(batch_size, Integral):
            raise DeuxError(f"batch_size is {batch_size}: it must be a whole number.")
        return _predict_stream(_zipped(image, sparse_depth, intrinsics), model, batch_size, corrected)
    frames = _checked(image, sparse_depth, intrinsics, model)  # type: ignore[arg-type]
    if frames.image.ndim == 4:
        return _predict(frames, model, corrected)
    return _predict(_stacked([frames]), model, corrected)[0]


def predict_batch(
    image: np.ndarray, sparse_depth: np.ndarray, intrinsics: np.ndarray, model: DepthModel, corrected: bool = False
) -> np.ndarray:
    """Like `predict_arrays`, for N frames with a matrix each, without checking cameras and unit of depth again."""
    return _predict(_checked(image, sparse_depth, intrinsics, model, first=False), model, corrected)


class _Inputs(NamedTuple):
    """One frame, or N frames with a matrix each; float32, images in [0, 1]."""

    image: np.ndarray
    sparse_depth: np.ndarray
    intrinsics: np.ndarray


def _checked(
    image: ArrayLike, sparse_depth: ArrayLike, intrinsics: ArrayLike, model: DepthModel, first: bool = True
) -> _Inputs:
    """Convert and check the user's inputs; N frames get a matrix each. Only a `first` frame's camera is checked."""
    colors, points, cameras = _image(image), _sparse_depth(sparse_depth), _intrinsics(intrinsics)
    _check_shapes(colors, points, cameras)
    _check_unit(points, model.max_depth, 1.0 if first else OTHER_UNIT)
    if first:
        _check_camera(cameras, *points.shape[-2:])
    if colors.ndim == 4:
        cameras = np.broadcast_to(cameras, (len(colors), 3, 3)).copy()
    return _Inputs(colors, points, cameras)


def _stacked(frames: Sequence[_Inputs]) -> _Inputs:
    return _Inputs(*(np.stack(arrays) for arrays in zip(*frames, strict=True)))


def _predict(frames: _Inputs, model: DepthModel, corrected: bool) -> np.ndarray:
    """Predict N frames, N x H x W float32 metres."""
    points = torch.from_numpy(frames.sparse_depth)[:, None]
    with torch.autocast(device_of(model).type, enabled=False):
        depth = model.predict(
            torch.from_numpy(frames.image).permute(0, 3, 1, 2).contiguous(),
            points,
            torch.from_numpy(frames.intrinsics),
        )
        if corrected:
            depth = correct_depth(depth, points.to(depth.device))
    return check_prediction(depth[:, 0].cpu().numpy())


def check_prediction(depths: np.ndarray) -> np.ndarray:
    """Return predicted depths, N x H x W metres, after checking that they are finite.

    Raises:
        DeuxError: a depth is NaN or infinite.
    """
    if not (finite := np.isfinite(depths)).all():
        raise DeuxError(
            f"the model predicts NaN or infinity at {np.count_nonzero(~finite):,} of {depths.size:,} pixels: its "
            "weights, its options or the frame are beyond what it can compute."
        )
    return depths


def _is_stream(value: object) -> bool:
    """Whether a value is an iterable of arrays, but not an array or a sequence."""
    array_like = isinstance(value, Sequence | memoryview | bytearray) or hasattr(value, "__array__")
    return isinstance(value, Iterable) and not array_like


def _zipped(image: Any, sparse_depth: Any, intrinsics: Any) -> Iterator[tuple[Any, Any, Any]]:
    """Zip the streams of the three inputs; intrinsics may be one matrix for all frames."""
    if not (_is_stream(image) and _is_stream(sparse_depth)):
        raise DeuxError("one of image and sparse_depth is an iterator and the other is not: both are, or neither.")
    rows = zip_longest(image, sparse_depth, *([intrinsics] if _is_stream(intrinsics) else []), fillvalue=_ENDED)
    return (_row(number, row, intrinsics) for number, row in enumerate(rows))


def _row(number: int, row: tuple[Any, ...], intrinsics: Any) -> tuple[Any, Any, Any]:
    names = ("image", "sparse_depth", "intrinsics")[: len(row)]
    ended = [name for name, value in zip(names, row, strict=True) if value is _ENDED]
    if ended:
        raise DeuxError(f"{' and '.join(ended)} ended after {number} frames, and the others did not.")
    return row if len(row) == 3 else (*row, intrinsics)


def _predict_stream(
    frames: Iterator[tuple[Any, Any, Any]], model: DepthModel, batch_size: int, corrected: bool
) -> Iterator[np.ndarray]:
    """Predict batches of frames of the same size; smaller ones when the size changes and at the end."""
    batch: list[_Inputs] = []
    for number, given in enumerate(frames):
        try:
            frame = _checked(*given, model, first=number == 0)
        except DeuxError as error:
            raise DeuxError(f"frame {number}: {error}") from error
        if frame.image.ndim != 3:
            raise DeuxError(
                f"frame {number}: image has the shape {sizes(frame.image.shape)}: a stream gives H x W x 3."
            )
        if batch and batch[0].image.shape != frame.image.shape:
            yield from _predict(_stacked(batch), model, corrected)
            batch = []
        batch.append(frame)
        if len(batch) == batch_size:
            yield from _predict(_stacked(batch), model, corrected)
            batch = []
    if batch:
        yield from _predict(_stacked(batch), model, corrected)


def _loaded(model: str | PathLike[str]) -> DepthModel:
    if not isinstance(model, str | PathLike):
        raise DeuxError(
            f"model is of the type {type(model).__name__}: it is a depth model, or the path of a run folder or model "
            "file."
        )
    return load_model(model)


def _array(name: str, value: ArrayLike) -> np.ndarray:
    """Convert a value to an array of numbers."""
    # numpy would silently drop the mask.
    if any(map(np.ma.is_masked, value if isinstance(value, list | tuple) else (value,))):
        raise DeuxError(f"{name} has masked values, which no model can be given: fill them, by .filled(0) or better.")
    try:
        array = np.asarray(value)
    except (TypeError, ValueError, RuntimeError) as error:
        reason = " ".join(str(error).split()).rstrip(".")
        raise DeuxError(f"{name} cannot be made an array ({reason}): it is a numpy array.") from error
    if array.dtype.kind not in "biuf":
        raise DeuxError(f"{name} is of the type {array.dtype}: it is an array of numbers.")
    return array


def _image(value: ArrayLike) -> np.ndarray:
    """Convert an image to floats in [0, 1]; the range of floats is checked by the model."""
    image = _array("image", value)
    if image.dtype == np.uint8:
        return image.astype(np.float32) / np.float32(255.0)
    if image.dtype.kind != "f":
        raise DeuxError(f"image is of the type {image.dtype}: it is uint8, or floating point in [0, 1].")
    return _float32(image)


def _sparse_depth(value: ArrayLike) -> np.ndarray:
    depth = _array("sparse_depth", [*map(_filled, value)] if isinstance(value, list | tuple) else _filled(value))
    if depth.dtype.kind != "f":
        raise DeuxError(
            f"sparse_depth is of the type {depth.dtype}: it is metres in floating point, so divide millimetres by "
            "1000.0 and the values of a 16-bit PNG in metres x 256 by 256.0."
        )
    return _float32(depth)


def _filled(value: Any) -> Any:
    """Fill the masked values of a masked array with 0; other values are returned unchanged."""
    return value.filled(0) if isinstance(value, np.ma.MaskedArray) else value


def _intrinsics(value: ArrayLike) -> np.ndarray:
    return _float32(_array("intrinsics", value))


def _float32(array: np.ndarray) -> np.ndarray:
    """A writable copy in C order, for torch; values beyond the range of float32 become infinite."""
    with np.errstate(over="ignore"):
        return np.array(array, dtype=np.float32, order="C")


def _check_shapes(image: np.ndarray, sparse_depth: np.ndarray, intrinsics: np.ndarray) -> None:
    if image.ndim not in (3, 4) or image.shape[-1] != 3 or image.size == 0:
        raise DeuxError(
            f"image has the shape {sizes(image.shape)}: it is H x W x 3 (red, green, blue), or N x H x W x 3 for N "
            "frames."
        )
    if sparse_depth.shape != image.shape[:-1]:
        raise DeuxError(
            f"sparse_depth has the shape {sizes(sparse_depth.shape)}: for an image of {sizes(image.shape)} it is "
            f"{' x '.join(map(str, image.shape[:-1]))}."
        )
    batched = image.ndim == 4 and intrinsics.shape == (len(image), 3, 3)
    if intrinsics.shape != (3, 3) and not batched:
        wanted = f"3 x 3, or {len(image)} x 3 x 3" if image.ndim == 4 else "3 x 3"
        raise DeuxError(
            f"intrinsics has the shape {sizes(intrinsics.shape)}: for an image of {sizes(image.shape)} it is {wanted}."
        )


def _check_camera(intrinsics: np.ndarray, height: int, width: int) -> None:
    """Warn of the first matrix that seems to belong to images of another size."""
    for matrix in intrinsics.reshape(-1, 3, 3):
        if not np.isfinite(matrix).all():
            return  # the model raises an error
        if warning := camera_warning(matrix, height, width, "the matrix intrinsics"):
            log.warning(warning)
            return


def _check_unit(sparse_depth: np.ndarray, max_depth: float, most: float) -> None:
    """Raise DeuxError if all points are farther away than `most` times the model's largest depth."""
    points = sparse_depth[sparse_depth > 0]
    if points.size and most * max_depth < points.min() < np.inf:
        raise DeuxError(
            f"the nearest point of sparse_depth is at {points.min():g} and the model predicts up to {max_depth:g} "
            "metres: sparse_depth is in metres, so divide millimetres by 1000 and centimetres by 100."
        )
