from dataclasses import replace

import numpy as np
import torch

from deux.contracts import Uncertainty
from deux.data.sample_parts import mirrored_matrix
from deux.testing.uncertainties import UncertaintySuite, point_grid, wall_view
from deux_plugins.uncertainties.disagreement import FlipDisagreement, HiddenPointsDisagreement


class TestFlipDisagreement(UncertaintySuite):
    def make_uncertainty(self) -> Uncertainty:
        return FlipDisagreement()


class TestHiddenPointsDisagreement(UncertaintySuite):
    def make_uncertainty(self) -> Uncertainty:
        return HiddenPointsDisagreement()


def test_flip_agrees_with_itself_where_the_model_is_symmetric():
    def model(image, sparse_depth, intrinsics):
        return image.mean(1, keepdim=True)

    view = wall_view(wall_view().image.mean(1, keepdim=True), predict_depth=model)
    assert FlipDisagreement()(view).max() < 1e-6


def test_flip_is_the_difference_in_metres_to_the_mirrored_answer():
    """A model that adds 1 cm for each column from the left, whatever it sees."""
    ramp = 0.01 * torch.arange(64.0).expand(1, 1, 48, 64)
    view = wall_view(2.0 + ramp, predict_depth=lambda image, sparse_depth, intrinsics: 2.0 + ramp)
    torch.testing.assert_close(FlipDisagreement()(view)[0], (2.0 * ramp - 0.63)[0, 0].abs())


def test_flip_mirrors_the_camera():
    seen = []

    def model(image, sparse_depth, intrinsics):
        seen.append(intrinsics[0].numpy().copy())
        return image[:, :1]

    view = wall_view(predict_depth=model)
    view.intrinsics[:, 0, 1] = 2.0
    view.intrinsics[:, 0, 2] = 20.0
    given = view.intrinsics[0].numpy().copy()
    FlipDisagreement()(view)
    np.testing.assert_allclose(seen, [mirrored_matrix(given, view.image.shape[-2:], 0)])
    np.testing.assert_array_equal(view.intrinsics[0], given)


def test_flip_takes_an_answer_of_any_precision():
    view = wall_view()
    half = replace(view, predict_depth=lambda image, sparse_depth, intrinsics: view.depth.bfloat16())
    assert FlipDisagreement()(half).dtype == torch.float32


def test_hidden_points_asks_once_for_both_halves_of_the_points():
    """A model whose depth is 10 cm for each point: all 48 say 4.8 m, either half 2.4 m."""
    asked = []

    def model(image, sparse_depth, intrinsics):
        asked.append(len(image))
        count = (sparse_depth > 0).flatten(1).sum(1)
        return 0.1 * count[:, None, None, None].expand(-1, 1, 48, 64)

    view = wall_view(torch.full((1, 1, 48, 64), 4.8), points=point_grid(), predict_depth=model)
    torch.testing.assert_close(HiddenPointsDisagreement()(view), torch.full((1, 48, 64), 2.4))
    assert asked == [2]
