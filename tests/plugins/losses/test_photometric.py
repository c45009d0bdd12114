"""The better source frame pixel by pixel, against what hides behind a box."""

import math

import numpy as np
import pytest
import torch
from torch import Tensor

from deux.contracts import Batch, Channel, LossInputs, Prediction, Reconstructions
from deux.geometry.camera import Camera
from deux.geometry.poses import camera_pose, source_from_target
from deux.geometry.reprojection import reproject
from deux.testing.box_world import Box, BoxWorld
from deux.testing.losses import DEPTH_RANGE
from deux_plugins.losses.color_consistency import ColorConsistency
from deux_plugins.losses.photometric import PhotometricAverage
from deux_plugins.losses.structural_consistency import StructuralConsistency


def residuals() -> tuple[Tensor, Tensor, Tensor]:
    generator = torch.Generator().manual_seed(0)
    residual = torch.rand(3, 2, 5, 7, generator=generator)
    visible = torch.rand(3, 2, 5, 7, generator=generator) < 0.6
    validity = (torch.rand(3, 1, 5, 7, generator=generator) < 0.2).float()
    return residual, visible, validity


@pytest.mark.parametrize("skip_points", [False, True])
@pytest.mark.parametrize("divisor", ["counted", "image"])
@pytest.mark.parametrize("pixels", ["visible", "all"])
def test_best_is_the_least_counted_residual_of_each_pixel(pixels: str, divisor: str, skip_points: bool) -> None:
    residual, visible, validity = residuals()
    expected = []
    for sample in range(3):
        least = []
        for row, column in np.ndindex(5, 7):
            if skip_points and validity[sample, 0, row, column] > 0:
                continue
            there = [
                float(residual[sample, s, row, column])
                for s in (0, 1)
                if pixels == "all" or visible[sample, s, row, column]
            ]
            least += [min(there)] if there else []
        expected.append(2 * sum(least) / (len(least) if divisor == "counted" else 35))
    average = PhotometricAverage(pixels, skip_points, divisor, "best")  # type: ignore[arg-type]
    assert float(average(residual, visible, validity)) == pytest.approx(np.mean(expected), rel=1e-5)


def test_gradients_reach_the_better_source_frame_alone() -> None:
    residual, visible, validity = residuals()
    residual.requires_grad_()
    PhotometricAverage(sources="best")(residual, visible, validity).backward()
    gradient = residual.grad
    assert gradient is not None
    assert (gradient[~visible] == 0).all()
    both = visible.all(dim=1)
    worse = residual.detach().argmax(dim=1, keepdim=True)
    assert (gradient.gather(1, worse)[:, 0][both] == 0).all()
    torch.testing.assert_close((gradient != 0).sum(dim=1), visible.any(dim=1).long())


def test_equal_source_frames_cost_what_their_sum_does() -> None:
    residual, visible, validity = residuals()
    residual, visible = residual[:, :1].expand(-1, 2, -1, -1), visible[:, :1].expand(-1, 2, -1, -1)
    mean, best = (PhotometricAverage(sources=sources)(residual, visible, validity) for sources in ("mean", "best"))
    torch.testing.assert_close(mean, best)


def test_one_source_frame_is_the_best() -> None:
    residual, visible, validity = residuals()
    one = residual[:, :1], visible[:, :1], validity
    assert torch.equal(PhotometricAverage(sources="best")(*one), PhotometricAverage()(*one))


def behind_a_box() -> LossInputs:
    """The exact depth of a room with a pillar that hides parts of it from cameras on either side of the target's."""
    room = BoxWorld(4.0, 6.0, (Box(1.8, 3.0, 2.2, 3.4),), Camera(96, 96))
    poses = np.stack([camera_pose(x, 1.25, 4.4, math.radians(0.0)) for x in (2.0, 2.4, 1.6)])
    target, *sources = room.render(poses, frozenset({Channel.COLOR}))

    def picture(rgb: np.ndarray) -> Tensor:
        return torch.from_numpy(rgb.astype(np.float32) / 255.0).permute(2, 0, 1)

    depth = torch.from_numpy(target.depth)[None, None]
    intrinsics = torch.from_numpy(room.camera.intrinsics).float()[None]
    motions = torch.from_numpy(source_from_target(poses[0], poses[1:])).float()[None]
    images = torch.stack([picture(frame.rgb) for frame in sources])[None]
    batch = Batch(picture(target.rgb)[None], images, depth, (depth > 0).float(), depth, intrinsics, motions)
    rebuilt, visible = reproject(images, depth, intrinsics, motions)
    return LossInputs(batch, Prediction(depth), Reconstructions(rebuilt, visible, motions), DEPTH_RANGE)


@pytest.mark.parametrize("term", [ColorConsistency, StructuralConsistency])
def test_what_one_source_frame_hides_costs_little_where_the_other_shows_it(
    term: type[ColorConsistency] | type[StructuralConsistency],
) -> None:
    """The exact depth is not free: hidden points are compared with the pillar's colour."""
    inputs = behind_a_box()
    assert float(term(sources="best")(inputs)) < 0.6 * float(term()(inputs))
