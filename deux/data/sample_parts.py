"""The parts of a training sample as TVTensors, with the kernels that torchvision's transforms v2 apply to them.

    "images"              tv_tensors.Image    (1 + S) x 3 x H x W, frame t first
    "sparse_depth"        DepthMap            H x W metres, the reference of the losses
    "input_sparse_depth"  InputSparseDepth    H x W metres, the input of the network
    "ground_truth"        DepthMap            H x W metres; only if it is read
    "intrinsics"          Intrinsics          3 x 3
    "source_from_target"  SourcePoses         S x 4 x 4; only if the frames have poses

Crops, padding, flips and resizing change images, depth maps, intrinsics and poses consistently: every point of the
scene is still projected to its pixel in all frames. Transforms after which the camera is not a pinhole camera with the
matrix (fx s cx, 0 fy cy, 0 0 1) raise an error.
"""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, NoReturn

import numpy as np
import torch
from torch import Tensor
from torchvision.transforms import InterpolationMode
from torchvision.transforms.v2 import functional
from torchvision.tv_tensors import Image, Mask, TVTensor, wrap

from deux.errors import DeuxError


class DepthMap(Mask):
    """H x W float32 metres along the optical axis, 0 = none.

    A subclass of torchvision's `Mask`: transformed like the images, but never interpolated or changed in value.
    """


class InputSparseDepth(DepthMap):
    """The sparse depth that is the network's input; the losses compare with another one.

    `points` is the number of points and `span` the depth in metres of the nearest and the farthest. They are set if
    known beforehand, since computing them would make the host wait for a GPU. Flips preserve them; after other
    geometric transforms they are None.
    """

    points: int | None = None
    span: tuple[float, float] | None = None

    def find_span(self) -> tuple[float, float] | None:
        """Depth in metres of the nearest and the farthest point; None without points."""
        if self.span is not None or self.points == 0:
            return self.span
        depth = self.as_subclass(Tensor)
        return depth_span(depth[depth > 0])


def depth_span(depth: np.ndarray | Tensor) -> tuple[float, float] | None:
    """The least and the greatest of N depths in metres; None if N is 0."""
    return (float(depth.min()), float(depth.max())) if len(depth) else None


class Intrinsics(TVTensor):
    """A camera matrix, for pixel centres at integers.

    Args:
        matrix: 3 x 3.
        canvas_size: height and width of the camera's images.
    """

    canvas_size: tuple[int, int]

    def __new__(cls, matrix: Tensor, canvas_size: tuple[int, int]) -> "Intrinsics":
        """View a matrix as intrinsics, without a copy."""
        intrinsics = matrix.as_subclass(cls)
        intrinsics.canvas_size = canvas_size
        return intrinsics


class SourcePoses(TVTensor):
    """S x 4 x 4, each transforms points of the target camera to a source camera."""


PART_TYPES: Mapping[str, type[TVTensor]] = {
    "images": Image,
    "sparse_depth": DepthMap,
    "ground_truth": DepthMap,
    "intrinsics": Intrinsics,
    "source_from_target": SourcePoses,
}
"""The type of each part before augmentation; "input_sparse_depth" is copied from "sparse_depth"."""


def with_points(depth: Tensor, points: int | None, span: tuple[float, float] | None = None) -> InputSparseDepth:
    """View a depth map as `InputSparseDepth` with its number of points and span."""
    shown: InputSparseDepth = depth.as_subclass(InputSparseDepth)
    shown.points, shown.span = points, span
    return shown


@functional.register_kernel(functional.horizontal_flip, InputSparseDepth)
def horizontal_flip_input_points(depth: InputSparseDepth) -> InputSparseDepth:
    """Flip left to right; `points` and `span` are preserved."""
    return with_points(depth.as_subclass(Tensor).flip(-1), depth.points, depth.span)


@functional.register_kernel(functional.vertical_flip, InputSparseDepth)
def vertical_flip_input_points(depth: InputSparseDepth) -> InputSparseDepth:
    """Flip top to bottom; `points` and `span` are preserved."""
    return with_points(depth.as_subclass(Tensor).flip(-2), depth.points, depth.span)


@functional.register_kernel(functional.crop, Intrinsics)
def crop_intrinsics(intrinsics: Intrinsics, top: int, left: int, height: int, width: int) -> Intrinsics:
    """Shift the principal point by the corner of the crop, which may lie outside of the image."""
    return _shifted(intrinsics, (height, width), -left, -top)


@functional.register_kernel(functional.center_crop, Intrinsics)
def center_crop_intrinsics(intrinsics: Intrinsics, output_size: int | Sequence[int]) -> Intrinsics:
    """Shift the principal point by the corner of the centre crop, which may be larger than the image."""
    sides = [output_size] * 2 if isinstance(output_size, int) else [*output_size] * (2 // len(output_size))
    new = sides[0], sides[1]
    top, left = (
        (after - before) // 2 if after > before else -round((before - after) / 2)
        for before, after in zip(intrinsics.canvas_size, new, strict=True)
    )
    return _shifted(intrinsics, new, left, top)


@functional.register_kernel(functional.pad, Intrinsics)
def pad_intrinsics(
    intrinsics: Intrinsics, padding: int | Sequence[int], fill: Any = None, padding_mode: str = "constant"
) -> Intrinsics:
    """Shift the principal point by the padding on the left and at the top.

    Raises:
        DeuxError: the padding repeats or reflects pixels.
    """
    if padding_mode != "constant":
        raise DeuxError(
            f"The augmentation pads the frames by repeating their pixels (padding_mode={padding_mode!r}), which does "
            "not match a camera: only 'constant' is possible."
        )
    sides = [padding] * 4 if isinstance(padding, int) else [*padding] * (4 // len(padding))
    left, top, right, bottom = sides
    height, width = intrinsics.canvas_size
    return _shifted(intrinsics, (height + top + bottom, width + left + right), left, top)


@functional.register_kernel(functional.resize, Intrinsics)
def resize_intrinsics(
    intrinsics: Intrinsics, size: Sequence[int] | None, max_size: int | None = None, **options: Any
) -> Intrinsics:
    """Scale the camera matrix such that the outer edges of the image stay its edges (half a pixel from the centres)."""
    # On the meta device torchvision computes only the size.
    resized = functional.resize(torch.empty(1, *intrinsics.canvas_size, device="meta"), size, max_size=max_size)
    height, width = resized.shape[-2:]
    x, y = width / intrinsics.canvas_size[1], height / intrinsics.canvas_size[0]
    pixels = ((x, 0.0, x / 2 - 0.5), (0.0, y, y / 2 - 0.5), (0.0, 0.0, 1.0))
    return _moved(intrinsics, pixels, (height, width))


@functional.register_kernel(functional.resized_crop, Intrinsics)
def resized_crop_intrinsics(
    intrinsics: Intrinsics, top: int, left: int, height: int, width: int, size: Sequence[int], **options: Any
) -> Intrinsics:
    """Crop, then resize."""
    return resize_intrinsics(crop_intrinsics(intrinsics, top, left, height, width), size)


def mirrored_matrix(matrix: np.ndarray, canvas_size: tuple[int, int], axis: int) -> np.ndarray:
    """The intrinsics of a flipped image, in a world whose axis is flipped too.

    Along x (axis 0) cx becomes W - 1 - cx, along y (axis 1) cy becomes H - 1 - cy; the skew changes its sign.

    Args:
        matrix: 3 x 3.
        canvas_size: height and width of the image.
        axis: 0 for left to right, 1 for top to bottom.
    """
    pixels, mirror = np.eye(3), np.ones(3)
    pixels[axis, axis], pixels[axis, 2], mirror[axis] = -1.0, canvas_size[1 - axis] - 1.0, -1.0
    return pixels @ matrix * mirror


def mirrored_motions(motions: np.ndarray, axis: int) -> np.ndarray:
    """Relative poses in a world with a flipped axis: T becomes M T M, where M is the identity with -1 on the axis.

    Args:
        motions: S x 4 x 4.
        axis: 0 for x, 1 for y.
    """
    mirror = np.ones(4)
    mirror[axis] = -1.0
    return mirror[:, None] * motions * mirror


def _mirror_intrinsics(intrinsics: Intrinsics, axis: int) -> Intrinsics:
    matrix = mirrored_matrix(intrinsics.as_subclass(Tensor).numpy(), intrinsics.canvas_size, axis)
    return Intrinsics(torch.from_numpy(matrix), intrinsics.canvas_size)


def _mirror_poses(poses: SourcePoses, axis: int) -> SourcePoses:
    motions: SourcePoses = torch.from_numpy(mirrored_motions(poses.as_subclass(Tensor).numpy(), axis)).as_subclass(
        SourcePoses
    )
    return motions


for _axis, _flip in enumerate((functional.horizontal_flip, functional.vertical_flip)):
    functional.register_kernel(_flip, Intrinsics)(partial(_mirror_intrinsics, axis=_axis))
    functional.register_kernel(_flip, SourcePoses)(partial(_mirror_poses, axis=_axis))


@functional.register_kernel(functional.pad, DepthMap)
def pad_depth(
    depth: DepthMap, padding: int | Sequence[int], fill: Any = None, padding_mode: str = "constant"
) -> DepthMap:
    """Pad with 0 (no depth), whatever the images are padded with."""
    sides = [padding] if isinstance(padding, int) else [*padding]
    return wrap(
        functional.pad(depth.as_subclass(Tensor)[None], sides, fill=0, padding_mode=padding_mode)[0], like=depth
    )


@functional.register_kernel(functional.resize, DepthMap)
def resize_depth(depth: DepthMap, size: Sequence[int] | None, max_size: int | None = None, **options: Any) -> DepthMap:
    """Resize by exact nearest neighbours; torchvision's kernel for masks is off by half a pixel."""
    exact = InterpolationMode.NEAREST_EXACT
    return wrap(functional.resize(depth.as_subclass(Tensor)[None], size, exact, max_size)[0], like=depth)


@functional.register_kernel(functional.resized_crop, DepthMap)
def resized_crop_depth(
    depth: DepthMap, top: int, left: int, height: int, width: int, size: Sequence[int], **options: Any
) -> DepthMap:
    """Crop, then resize."""
    return resize_depth(functional.crop(depth, top, left, height, width), size)


def _refuse(operation: Callable[..., Any]) -> None:
    """Register a kernel that raises an error for a transform that a pinhole camera cannot follow."""

    @functional.register_kernel(operation, Intrinsics)
    def refuse(intrinsics: Intrinsics, *arguments: Any, **options: Any) -> NoReturn:
        raise DeuxError(
            f"The augmentation uses torchvision's {operation.__name__}, after which no pinhole camera fits the frames: "
            "only crops, padding, flips, resizing and changes of colours are possible."
        )


for _operation in (functional.affine, functional.elastic, functional.perspective, functional.rotate):
    _refuse(_operation)


def _shifted(intrinsics: Intrinsics, canvas_size: tuple[int, int], left: int, top: int) -> Intrinsics:
    """The camera after a translation of the pixels by (left, top)."""
    return _moved(intrinsics, ((1.0, 0.0, left), (0.0, 1.0, top), (0.0, 0.0, 1.0)), canvas_size)


def _moved(intrinsics: Intrinsics, pixels: Sequence[Sequence[float]], canvas_size: tuple[int, int]) -> Intrinsics:
    """The camera matrix A K after an affine transform A of the pixels.

    Args:
        intrinsics: K.
        pixels: A, 3 x 3, transforms homogeneous pixels.
        canvas_size: height and width of the images afterwards.
    """
    # NumPy is faster than torch for matrices this small.
    matrix = np.array(pixels) @ intrinsics.as_subclass(Tensor).numpy()
    return Intrinsics(torch.from_numpy(matrix), canvas_size)
