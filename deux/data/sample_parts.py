"""The parts of a training sample to torchvision's transforms v2, and how crops, flips and changes of size act on them.

    "images"              tv_tensors.Image    (1 + S) x 3 x H x W, frame t first
    "sparse_depth"        DepthMap            H x W metres, what the losses compare with
    "input_sparse_depth"  InputSparseDepth    H x W metres, what the network is shown
    "ground_truth"        DepthMap            H x W metres; only where it was read
    "intrinsics"          Intrinsics          3 x 3
    "source_from_target"  SourcePoses         S x 4 x 4; only where the frames have poses

Crops, paddings, flips and changes of size change the images, the depth maps, the intrinsics and the poses together, so
that a point of the scene still lies on its pixel in every frame. Transforms after which the camera is no pinhole camera
with the matrix (fx s cx, 0 fy cy, 0 0 1) are refused.
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

    A mask to torchvision: moved as the images are, untouched by what changes colours, never interpolated.
    """


class InputSparseDepth(DepthMap):
    """The sparse depth that the network is shown; the losses read another one.

    `points` is the number of its points and `span` the depth in metres of the nearest and the farthest, where they are
    known without looking at it, which would make the host wait for a card. Flips keep them; after other changes of the
    geometry they are None.
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
    """The least and the greatest of N depths in metres; None of none."""
    return (float(depth.min()), float(depth.max())) if len(depth) else None


class Intrinsics(TVTensor):
    """A camera's 3 x 3 matrix, for pixel centres at integers.

    Args:
        matrix: 3 x 3.
        canvas_size: height and width of the images that it belongs to.
    """

    canvas_size: tuple[int, int]

    def __new__(cls, matrix: Tensor, canvas_size: tuple[int, int]) -> "Intrinsics":
        """The matrix itself, not a copy."""
        intrinsics = matrix.as_subclass(cls)
        intrinsics.canvas_size = canvas_size
        return intrinsics


class SourcePoses(TVTensor):
    """S x 4 x 4, each carries points of the target camera into a source camera."""


PART_TYPES: Mapping[str, type[TVTensor]] = {
    "images": Image,
    "sparse_depth": DepthMap,
    "ground_truth": DepthMap,
    "intrinsics": Intrinsics,
    "source_from_target": SourcePoses,
}
"""Of each part that a sample begins with; "input_sparse_depth" comes from "sparse_depth"."""


def with_points(depth: Tensor, points: int | None, span: tuple[float, float] | None = None) -> InputSparseDepth:
    """A depth map as the network's input; what is known of its points as of `InputSparseDepth`."""
    shown: InputSparseDepth = depth.as_subclass(InputSparseDepth)
    shown.points, shown.span = points, span
    return shown


@functional.register_kernel(functional.horizontal_flip, InputSparseDepth)
def horizontal_flip_input_points(depth: InputSparseDepth) -> InputSparseDepth:
    """Mirror left to right; what is known of the points stays known."""
    return with_points(depth.as_subclass(Tensor).flip(-1), depth.points, depth.span)


@functional.register_kernel(functional.vertical_flip, InputSparseDepth)
def vertical_flip_input_points(depth: InputSparseDepth) -> InputSparseDepth:
    """Mirror top to bottom; what is known of the points stays known."""
    return with_points(depth.as_subclass(Tensor).flip(-2), depth.points, depth.span)


@functional.register_kernel(functional.crop, Intrinsics)
def crop_intrinsics(intrinsics: Intrinsics, top: int, left: int, height: int, width: int) -> Intrinsics:
    """Move the principal point with the window's corner, which may lie outside of the image."""
    return _shifted(intrinsics, (height, width), -left, -top)


@functional.register_kernel(functional.center_crop, Intrinsics)
def center_crop_intrinsics(intrinsics: Intrinsics, output_size: int | Sequence[int]) -> Intrinsics:
    """Move the principal point with the window in the middle, which may be larger than the image."""
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
    """Move the principal point by what is added on the left and above.

    Raises:
        DeuxError: the padding repeats or mirrors pixels, which no camera sees there.
    """
    if padding_mode != "constant":
        raise DeuxError(
            f"The augmentation pads the frames by repeating their pixels (padding_mode={padding_mode!r}), which no "
            "camera sees there: only 'constant' is possible."
        )
    sides = [padding] * 4 if isinstance(padding, int) else [*padding] * (4 // len(padding))
    left, top, right, bottom = sides
    height, width = intrinsics.canvas_size
    return _shifted(intrinsics, (height + top + bottom, width + left + right), left, top)


@functional.register_kernel(functional.resize, Intrinsics)
def resize_intrinsics(
    intrinsics: Intrinsics, size: Sequence[int] | None, max_size: int | None = None, **options: Any
) -> Intrinsics:
    """Scale the focal lengths; the image's corners, half a pixel outside of the outermost centres, stay its corners."""
    # A tensor without memory: torchvision computes the size alone.
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
    """The intrinsics of a mirror image, in the mirrored world in which the axis points the other way.

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
    """The motions of the mirrored world: T becomes M T M, where M is the identity with -1 on the axis.

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
    """Nothing is known in what is added, whatever the images are filled with there."""
    sides = [padding] if isinstance(padding, int) else [*padding]
    return wrap(
        functional.pad(depth.as_subclass(Tensor)[None], sides, fill=0, padding_mode=padding_mode)[0], like=depth
    )


@functional.register_kernel(functional.resize, DepthMap)
def resize_depth(depth: DepthMap, size: Sequence[int] | None, max_size: int | None = None, **options: Any) -> DepthMap:
    """The nearest pixel's depth, of pixel centres; torchvision's masks are off by half a pixel."""
    exact = InterpolationMode.NEAREST_EXACT
    return wrap(functional.resize(depth.as_subclass(Tensor)[None], size, exact, max_size)[0], like=depth)


@functional.register_kernel(functional.resized_crop, DepthMap)
def resized_crop_depth(
    depth: DepthMap, top: int, left: int, height: int, width: int, size: Sequence[int], **options: Any
) -> DepthMap:
    """Crop, then resize."""
    return resize_depth(functional.crop(depth, top, left, height, width), size)


def _refuse(operation: Callable[..., Any]) -> None:
    """Refuse a functional of torchvision under which a pinhole camera does not stay one."""

    @functional.register_kernel(operation, Intrinsics)
    def refuse(intrinsics: Intrinsics, *arguments: Any, **options: Any) -> NoReturn:
        raise DeuxError(
            f"The augmentation uses torchvision's {operation.__name__}, after which no pinhole camera fits the frames: "
            "crops, paddings, flips, changes of size and of colours are possible."
        )


for _operation in (functional.affine, functional.elastic, functional.perspective, functional.rotate):
    _refuse(_operation)


def _shifted(intrinsics: Intrinsics, canvas_size: tuple[int, int], left: int, top: int) -> Intrinsics:
    """The camera after every pixel has moved by (left, top)."""
    return _moved(intrinsics, ((1.0, 0.0, left), (0.0, 1.0, top), (0.0, 0.0, 1.0)), canvas_size)


def _moved(intrinsics: Intrinsics, pixels: Sequence[Sequence[float]], canvas_size: tuple[int, int]) -> Intrinsics:
    """The camera whose pixels are A times those of K: A K.

    Args:
        intrinsics: K.
        pixels: A, 3 x 3, carries homogeneous pixels to where they are now.
        canvas_size: height and width of the images now.
    """
    # In numpy, for which nine numbers are less work.
    matrix = np.array(pixels) @ intrinsics.as_subclass(Tensor).numpy()
    return Intrinsics(torch.from_numpy(matrix), canvas_size)
