import pytest
import torch

from deux.contracts import Uncertainty
from deux.errors import DeuxError
from deux.testing.uncertainties import HEIGHT, WALL, WIDTH, UncertaintySuite, point_grid, wall_view
from deux_example.interpolation_gap import InterpolationGap

TOO_FAR = torch.full((1, 1, HEIGHT, WIDTH), 1.1 * WALL)


class TestInterpolationGap(UncertaintySuite):
    computes_on_host = True  # by scipy

    def make_uncertainty(self) -> Uncertainty:
        return InterpolationGap()


def test_a_wall_predicted_ten_percent_too_far_has_the_gap_log_of_1_1_between_the_points() -> None:
    rows, columns = point_grid()[0, 0].nonzero().T
    expected = torch.full((1, HEIGHT, WIDTH), torch.nan)  # the points are a grid: their convex hull is a rectangle
    expected[:, rows.min() : rows.max() + 1, columns.min() : columns.max() + 1] = torch.tensor(1.1).log()
    gap = InterpolationGap()(wall_view(TOO_FAR, points=point_grid()))
    torch.testing.assert_close(gap, expected, equal_nan=True)


def test_a_frame_without_points_has_no_value() -> None:
    assert InterpolationGap()(wall_view(TOO_FAR)).isnan().all()


def test_a_least_depth_without_a_logarithm_is_refused() -> None:
    with pytest.raises(DeuxError, match=r"least_depth is 0\.0: it must be above 0"):
        InterpolationGap(least_depth=0.0)
