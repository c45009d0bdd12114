from dataclasses import replace

import numpy as np
import pytest
import torch
from kornia.metrics import ssim

from deux.contracts import Uncertainty
from deux.testing.uncertainties import UncertaintySuite, wall_view
from deux_plugins.uncertainties.photometric import L1Residual, SSIMResidual


class TestL1Residual(UncertaintySuite):
    def make_uncertainty(self) -> Uncertainty:
        return L1Residual()


class TestSSIMResidual(UncertaintySuite):
    def make_uncertainty(self) -> Uncertainty:
        return SSIMResidual()


def test_l1_is_the_mean_absolute_difference_to_the_visible_reconstructions():
    view = wall_view(torch.full((1, 1, 48, 64), 2.4))
    expected = np.zeros((48, 64))
    for row, column in np.ndindex(48, 64):
        errors = [
            (view.image[0, :, row, column] - view.rebuilt[0, source, :, row, column]).abs().mean().item()
            for source in range(2)
            if view.visible[0, source, 0, row, column]
        ]
        expected[row, column] = np.mean(errors) if errors else np.nan
    np.testing.assert_allclose(L1Residual()(view)[0], expected, atol=1e-6)


def test_ssim_is_that_of_kornia():
    generator = torch.Generator().manual_seed(0)
    view = wall_view(moves=((0.0, 0.0, 0.0),))
    image = torch.rand(1, 3, 48, 64, generator=generator)
    rebuilt = (image + 0.3 * torch.rand(1, 3, 48, 64, generator=generator)) / 1.3
    view = replace(view, image=image, rebuilt=rebuilt[:, None], visible=torch.ones_like(view.visible))
    expected = (1.0 - ssim(image, rebuilt, window_size=3).mean(dim=1)) / 2.0
    torch.testing.assert_close(SSIMResidual()(view), expected, rtol=1e-3, atol=1e-5)


@pytest.mark.parametrize("measure", [L1Residual(), SSIMResidual()])
def test_a_wrong_depth_is_less_certain_than_the_true_one(measure):
    right = measure(wall_view()).nanmean()
    wrong = measure(wall_view(torch.full((1, 1, 48, 64), 2.4))).nanmean()
    assert right < 0.01
    assert wrong > 3.0 * right


@pytest.mark.parametrize("measure", [L1Residual(), SSIMResidual()])
def test_a_turn_has_no_value_for_depth(measure):
    """What `parallax` is for: after a turn on the spot the residual is the same for any depth."""
    standing = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    right, wrong = (
        measure(wall_view(torch.full((1, 1, 48, 64), depth), standing, turn=0.17)).nanmean() for depth in (2.0, 3.0)
    )
    torch.testing.assert_close(right, wrong, rtol=1e-3, atol=1e-5)
