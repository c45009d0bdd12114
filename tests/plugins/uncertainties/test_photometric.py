import pytest
import torch

from deux_plugins.uncertainties.photometric import l1, ssim


@pytest.mark.parametrize("measure", [l1, ssim])
def test_a_wrong_depth_is_less_certain_than_the_true_one(measure, make_view):
    right = measure(make_view()).nanmean()
    wrong = measure(make_view(torch.full((1, 1, 48, 64), 2.4))).nanmean()
    assert right < 0.01
    assert wrong > 3.0 * right


@pytest.mark.parametrize("measure", [l1, ssim])
def test_a_turn_says_nothing_about_depth(measure, make_view):
    """What `parallax` is for: after a turn on the spot the residual is the same for any depth."""
    standing = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    right, wrong = (
        measure(make_view(torch.full((1, 1, 48, 64), depth), standing, turn=0.17)).nanmean() for depth in (2.0, 3.0)
    )
    torch.testing.assert_close(right, wrong, rtol=1e-3, atol=1e-5)
