"""How torchvision's crops, flips and changes of size act on a camera, relative poses and depth maps."""

from collections.abc import Callable

import numpy as np
import pytest
import torch
from torch import Tensor
from torchvision.transforms import v2
from torchvision.transforms.v2 import functional
from torchvision.tv_tensors import Image

from deux.data.sample_parts import DepthMap, Intrinsics, SourcePoses
from deux.errors import DeuxError

HEIGHT, WIDTH = 40, 48
MATRIX = torch.tensor([[30.0, 2.0, 20.0], [0.0, 28.0, 23.5], [0.0, 0.0, 1.0]], dtype=torch.float64)
MOTION = np.eye(4)
MOTION[:3, :3] = [[0.0, 0.0, 1.0], [0.6, 0.8, 0.0], [-0.8, 0.6, 0.0]]
MOTION[:3, 3] = [0.1, -0.2, 0.3]


def camera() -> Intrinsics:
    return Intrinsics(MATRIX.clone(), (HEIGHT, WIDTH))


@pytest.mark.parametrize(
    ("operation", "mirror"),
    [
        (lambda x: functional.crop(x, 5, 7, 20, 24), 1),
        (lambda x: functional.crop(x, -3, 30, 60, 40), 1),
        (lambda x: functional.center_crop(x, [21, 30]), 1),
        (lambda x: functional.center_crop(x, [21, 61]), 1),
        (lambda x: functional.center_crop(x, [33]), 1),
        (lambda x: functional.pad(x, [3]), 1),
        (lambda x: functional.pad(x, [3, 5]), 1),
        (lambda x: functional.pad(x, [1, 2, 3, 4]), 1),
        (lambda x: functional.horizontal_flip(x), -1),
    ],
)
def test_a_point_of_the_scene_stays_on_its_pixel(operation: Callable[[Tensor], Tensor], mirror: int) -> None:
    """Each pixel of an image that holds its own ray, unprojected with the new intrinsics, gives that ray again."""
    rows, columns = torch.meshgrid(torch.arange(HEIGHT), torch.arange(WIDTH), indexing="ij")
    pixels = torch.stack([columns, rows, torch.ones_like(rows)]).double()
    rays = torch.einsum("ij,jhw->ihw", torch.linalg.inv(MATRIX), pixels)
    moved, changed = operation(rays.as_subclass(Image)), operation(camera())
    assert isinstance(changed, Intrinsics)
    assert changed.canvas_size == tuple(moved.shape[-2:])
    known = moved[2] != 0
    rows, columns = known.nonzero(as_tuple=True)
    here = torch.stack([columns, rows, torch.ones_like(rows)]).double()
    found = torch.linalg.inv(changed.as_subclass(Tensor)) @ here
    found[0] *= mirror
    torch.testing.assert_close(found, moved.as_subclass(Tensor)[:, known])


@pytest.mark.parametrize("size", [[20, 24], [80, 96], [37, 61], [30]])
def test_resizing_keeps_the_corners_of_the_image(size: list[int]) -> None:
    changed = functional.resize(camera(), size)
    height, width = changed.canvas_size
    assert (height, width) == tuple(functional.resize(torch.zeros(1, HEIGHT, WIDTH), size).shape[-2:])
    for x, y in ((0, 0), (1, 0), (0, 1), (1, 1), (0.25, 0.5)):  # fractions of the image's sides
        before = torch.tensor([x * WIDTH - 0.5, y * HEIGHT - 0.5, 1.0], dtype=torch.float64)
        after = torch.tensor([x * width - 0.5, y * height - 0.5, 1.0], dtype=torch.float64)
        ray = torch.linalg.inv(MATRIX) @ before
        torch.testing.assert_close(changed.as_subclass(Tensor) @ ray, after)


@pytest.mark.parametrize(("flip", "axis"), [(functional.horizontal_flip, 0), (functional.vertical_flip, 1)])
def test_a_flip_shows_the_mirrored_world(flip: Callable[[Tensor], Tensor], axis: int) -> None:
    mirror = torch.ones(4, dtype=torch.float64)
    mirror[axis] = -1.0
    points = torch.rand(4, 50, dtype=torch.float64) + 1.0
    points[3] = 1.0
    mirrored = mirror[:, None] * points
    pixels, flipped = MATRIX @ points[:3], flip(camera()).as_subclass(Tensor) @ mirrored[:3]
    pixels, flipped = pixels[:2] / pixels[2], flipped[:2] / flipped[2]
    pixels[axis] = (WIDTH, HEIGHT)[axis] - 1 - pixels[axis]
    torch.testing.assert_close(flipped, pixels)
    motion = torch.from_numpy(MOTION)
    changed = flip(motion[None].as_subclass(SourcePoses)).as_subclass(Tensor)[0]
    torch.testing.assert_close(changed @ mirrored, mirror[:, None] * (motion @ points))
    torch.testing.assert_close(torch.linalg.det(changed[:3, :3]), torch.ones((), dtype=torch.float64))


def test_depth_is_never_interpolated_and_unknown_where_nothing_was_seen() -> None:
    depth = torch.arange(1.0, 13.0).reshape(3, 4).as_subclass(DepthMap)
    larger = functional.resize(depth, [6, 8]).as_subclass(Tensor)
    torch.testing.assert_close(larger, depth.as_subclass(Tensor).repeat_interleave(2, 0).repeat_interleave(2, 1))
    smaller = functional.resize(depth, [1, 2]).as_subclass(Tensor)
    torch.testing.assert_close(smaller, torch.tensor([[6.0, 8.0]]))  # the pixels under the new centres
    padded = functional.pad(depth, [1], fill=127.0).as_subclass(Tensor)
    assert padded.shape == (5, 6)
    assert float(padded.sum()) == float(depth.sum())
    assert isinstance(functional.resized_crop(depth, 0, 0, 2, 2, [4, 4]), DepthMap)


@pytest.mark.parametrize(
    "transform",
    [v2.RandomRotation(10), v2.RandomAffine(5), v2.RandomPerspective(p=1.0), v2.ElasticTransform()],
    ids=lambda transform: type(transform).__name__,
)
def test_what_no_pinhole_camera_sees_is_refused(transform: v2.Transform) -> None:
    with pytest.raises(
        DeuxError, match=r"^The augmentation uses torchvision's \w+, after which no pinhole camera fits"
    ):
        transform({"images": Image(torch.zeros(1, 3, HEIGHT, WIDTH)), "intrinsics": camera()})


def test_mirrored_borders_are_refused() -> None:
    with pytest.raises(DeuxError, match="padding_mode='reflect'"):
        v2.Pad(2, padding_mode="reflect")({"images": Image(torch.zeros(1, 3, HEIGHT, WIDTH)), "intrinsics": camera()})
