import torch

from deux.contracts import Uncertainty
from deux.testing.uncertainties import UncertaintySuite, point_grid, wall_view
from deux_example.interpolation_gap import InterpolationGap


class TestInterpolationGap(UncertaintySuite):
    def make_uncertainty(self) -> Uncertainty:
        return InterpolationGap()


def test_a_wall_predicted_ten_percent_too_far_has_the_gap_log_of_1_1() -> None:
    view = wall_view(points=point_grid())
    measured = view.sparse_depth[view.sparse_depth > 0].mean()
    view.depth.fill_(1.1 * float(measured))
    gap = InterpolationGap()(view)
    expected = torch.tensor(1.1).log().expand_as(gap)
    inside = gap.isfinite()
    assert inside.any()
    torch.testing.assert_close(gap[inside], expected[inside])
