import math
from dataclasses import fields

import pytest
import torch
from torch import Tensor

from deux.contracts import Uncertainty
from deux.errors import DeuxError
from deux.frame_uncertainty import frame_of, frame_uncertainty, make_view, pixel_uncertainty
from deux.geometry.reprojection import reproject
from deux.testing.uncertainties import WALL, wall_view


def test_frame_uncertainty_is_equation_eight_over_the_known_pixels():
    uncertainty = torch.tensor([[[0.1, 0.3], [torch.nan, 0.2]], [[torch.nan] * 2] * 2])
    delta = frame_uncertainty(uncertainty)
    assert delta[0].item() == pytest.approx(1.0 - math.exp(-0.2), rel=1e-6)
    assert delta[1].isnan()


def test_a_view_of_the_true_depth_rebuilds_the_frame():
    view = wall_view()
    error = (view.rebuilt - view.image[:, None]).abs()
    assert error[view.visible.expand_as(error)].max() < 0.02
    assert 0.5 < view.visible.float().mean() <= 1.0


def test_the_model_is_asked_once_and_its_depth_is_what_frames_are_rebuilt_with():
    given, asked = wall_view(), []

    def model(image: Tensor, sparse_depth: Tensor, intrinsics: Tensor) -> Tensor:
        asked.append(len(image))
        return torch.full((len(image), 1, *image.shape[2:]), 2.5, dtype=torch.bfloat16)

    inputs = (given.image, given.sparse_depth, given.intrinsics, given.sources, given.source_from_target)
    view = make_view(*inputs, model)
    assert asked == [1]
    assert view.depth.dtype == torch.float32
    rebuilt, visible = reproject(given.sources, torch.full_like(given.depth, 2.5), *inputs[2:3], inputs[4])
    torch.testing.assert_close(view.rebuilt, rebuilt)
    assert torch.equal(view.visible, visible)


def test_a_view_may_have_no_source_frame():
    given = wall_view()
    view = make_view(
        *(given.image, given.sparse_depth, given.intrinsics),
        *(given.sources[:, :0], given.source_from_target[:, :0]),
        given.predict_depth,
    )
    assert view.rebuilt.shape == (1, 0, 3, 48, 64)
    assert view.visible.shape == (1, 0, 1, 48, 64)


def test_a_frame_of_a_view_has_its_part_of_every_tensor():
    depth = torch.full((3, 1, 48, 64), WALL) + torch.tensor([0.0, 0.1, 0.2])[:, None, None, None]
    view = wall_view(depth)
    one = frame_of(view, 1)
    for field in fields(view):
        whole, part = getattr(view, field.name), getattr(one, field.name)
        if isinstance(whole, Tensor):
            assert torch.equal(part, whole[1:2])
        else:
            assert part is whole


@pytest.mark.parametrize(
    ("value", "told"),
    [
        (lambda depth: depth, "Tensor of 1 x 1 x 48 x 64, float32"),
        (lambda depth: depth[:, 0, ::2, ::2], "Tensor of 1 x 24 x 32, float32"),
        (lambda depth: depth.mean(), "Tensor of a single number, float32"),
        (lambda depth: depth[:, 0].numpy(), "ndarray of 1 x 48 x 64, float32"),
        (lambda depth: depth[:, 0] > 1, "Tensor of 1 x 48 x 64, bool"),
        (lambda depth: 0.5, "a value of the type float"),
        (lambda depth: None, "None"),
    ],
)
def test_a_measure_that_gives_no_value_for_each_pixel_is_named(value, told):
    class Odd(Uncertainty):
        def __call__(self, view):
            return value(view.depth)

    wanted = r"it must be a Tensor of N x H x W, float32, here 1 x 48 x 64\.$"
    with pytest.raises(DeuxError, match=f"^the measure of uncertainty Odd gives {told}: {wanted}"):
        pixel_uncertainty(Odd(), wall_view())
