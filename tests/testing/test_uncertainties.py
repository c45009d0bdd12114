"""The suite must pass a sound measure and catch each fault that it is there to catch."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from deux.contracts import Uncertainty
from deux.testing.uncertainties import WALL, CheckedPredictor, UncertaintySuite, point_grid, wall_view


class Sound(Uncertainty):
    """How much farther the model puts the frame without its points, NaN where no source frame sees the pixel."""

    def __call__(self, view):
        depth = view.predict_depth(view.image, torch.zeros_like(view.sparse_depth), view.intrinsics)
        return torch.where(view.visible.any(1), (depth - view.depth).abs(), torch.nan)[:, 0]


class KeepsTheChannel(Sound):
    def __call__(self, view):
        return super().__call__(view)[:, None]


class IsDouble(Sound):
    def __call__(self, view):
        return super().__call__(view).double()


class IsNegative(Sound):
    def __call__(self, view):
        return super().__call__(view) - 5.0


class IsInfinite(Sound):
    def __call__(self, view):
        return super().__call__(view) / view.sparse_depth[:, 0]


class HasNoValue(Sound):
    def __call__(self, view):
        return torch.full_like(view.depth[:, 0], torch.nan)


class IsNormalisedOverTheBatch(Sound):
    def __call__(self, view):
        uncertainty = super().__call__(view)
        return uncertainty / uncertainty.nanmean()


class DrawsByLot(Sound):
    def __call__(self, view):
        return torch.rand_like(view.depth[:, 0])


class Remembers(Sound):
    calls = 0

    def __call__(self, view):
        self.calls += 1
        return super().__call__(view) * self.calls


class WritesToTheView(Sound):
    def __call__(self, view):
        view.intrinsics[:, 0, 2] += 1.0
        return super().__call__(view)


class NeedsPoints(Sound):
    def __call__(self, view):
        for points in view.sparse_depth:
            points[points > 0].min()
        return super().__call__(view)


class NeedsTexture(Sound):
    def __call__(self, view):
        return super().__call__(view) / view.image.std((1, 2, 3), keepdim=True)[:, 0]


class TakesTwoSourceFrames(Sound):
    def __call__(self, view):
        first, _ = view.visible.unbind(1)
        return torch.where(first[:, 0], super().__call__(view), torch.nan)


class AsksForOneOfTheBatch(Sound):
    def __call__(self, view):
        return super().__call__(replace(view, intrinsics=view.intrinsics[:1]))


class AsksWithoutTheBatch(Sound):
    def __call__(self, view):
        view.predict_depth(view.image[0], view.sparse_depth[0], view.intrinsics[0])
        return super().__call__(view)


class AsksWithNoPointsAsNaN(Sound):
    def __call__(self, view):
        sparse_depth = torch.where(view.sparse_depth > 0, view.sparse_depth, torch.nan)
        view.predict_depth(view.image, sparse_depth, view.intrinsics)
        return super().__call__(view)


FAULTS = {
    KeepsTheChannel: "has_values_in_a_view_with_all_inputs",
    IsDouble: "has_values_in_a_view_with_all_inputs",
    IsNegative: "has_values_in_a_view_with_all_inputs",
    IsInfinite: "has_values_in_a_view_with_all_inputs",
    HasNoValue: "has_values_in_a_view_with_all_inputs",
    IsNormalisedOverTheBatch: "frames_of_a_batch_do_not_touch_each_other",
    DrawsByLot: "same_view_same_values",
    Remembers: "same_view_same_values",
    WritesToTheView: "leaves_the_view_alone",
    NeedsPoints: "survives_points_that_nothing_shows",
    NeedsTexture: "survives_an_image_of_one_colour",
    TakesTwoSourceFrames: "takes_any_number_of_source_frames",
    AsksForOneOfTheBatch: "frames_of_a_batch_do_not_touch_each_other",
    AsksWithoutTheBatch: "survives_a_camera_that_only_turned",
    AsksWithNoPointsAsNaN: "survives_a_camera_that_only_turned",
}


class TestSound(UncertaintySuite):
    def make_uncertainty(self) -> Uncertainty:
        return Sound()


@pytest.mark.parametrize(("measure", "test"), FAULTS.items(), ids=lambda value: getattr(value, "__name__", ""))
def test_a_fault_is_caught_by_the_test_that_is_there_for_it(measure, test):
    class Suite(UncertaintySuite):
        def make_uncertainty(self) -> Uncertainty:
            return measure()

    with pytest.raises((AssertionError, RuntimeError, ValueError, IndexError)):
        getattr(Suite(), f"test_{test}")()


def test_the_wall_is_seen_as_a_ray_caster_sees_it():
    """The colour of a pixel of the second source camera: the wall's formula at the point where its ray ends."""
    view = wall_view(moves=((0.0, 0.0, -0.25), (0.1, 0.0, -0.4)))
    row, column = 10, 50
    distance = WALL + 0.4
    x, y = 0.1 + distance * (column - 31.5) / 40.0, distance * (row - 23.5) / 40.0
    expected = [0.5 + 0.25 * np.sin(5.0 * x + phase) * np.cos(4.0 * y + phase) for phase in (0.0, 1.0, 2.0)]
    np.testing.assert_allclose(view.sources[0, 1, :, row, column], expected, atol=1e-5)


def test_points_have_the_true_depth():
    view = wall_view(torch.full((2, 1, 48, 64), 3.0), points=point_grid(), predict_depth=CheckedPredictor())
    assert view.sparse_depth.unique().tolist() == [0.0, WALL]
    assert (view.sparse_depth > 0).sum().item() == 2 * 48


def test_an_array_in_place_of_a_tensor_is_named_in_the_failure():
    class Array(Sound):
        def __call__(self, view):
            return super().__call__(view).numpy()

    class Suite(UncertaintySuite):
        def make_uncertainty(self) -> Uncertainty:
            return Array()

    with pytest.raises(AssertionError, match="not a Tensor: ndarray of 3 x 48 x 64, float32"):
        Suite().test_has_values_in_a_view_with_all_inputs()
