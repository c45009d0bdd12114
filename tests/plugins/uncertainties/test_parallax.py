import pytest
import torch

from deux.contracts import Uncertainty
from deux.testing.uncertainties import UncertaintySuite, wall_view
from deux_plugins.uncertainties.parallax import ParallaxCorrection


class TestParallaxCorrection(UncertaintySuite):
    def make_uncertainty(self) -> Uncertainty:
        return ParallaxCorrection()


@pytest.mark.parametrize("factor", [0.92, 1.05, 1.1])
def test_the_correction_is_the_error_of_the_depth_in_metres(factor):
    """The wall is 2 m away: a depth of 2 m x factor errs by 2 m x |factor - 1|, whatever the wall looks like."""
    uncertainty = ParallaxCorrection()(wall_view(torch.full((1, 1, 48, 64), 2.0 * factor)))
    assert uncertainty.nanmedian().item() == pytest.approx(2.0 * abs(factor - 1.0), rel=0.25)


def test_the_true_depth_needs_no_correction():
    assert ParallaxCorrection()(wall_view()).nanmean() < 0.02


def test_it_has_no_value_without_parallax():
    standing = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    view = wall_view(torch.full((1, 1, 48, 64), 2.4), standing, turn=0.17)
    assert ParallaxCorrection()(view).isnan().all()
