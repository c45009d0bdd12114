import pytest
import torch

from deux.contracts import Uncertainty
from deux.testing.uncertainties import UncertaintySuite, point_grid, wall_view
from deux_plugins.uncertainties.sparse_error import PRIOR_WEIGHT, SparseError


class TestSparseError(UncertaintySuite):
    def make_uncertainty(self) -> Uncertainty:
        return SparseError()


class TestRelativeSparseError(UncertaintySuite):
    def make_uncertainty(self) -> Uncertainty:
        return SparseError(relative=True)


def test_it_is_the_weighted_mean_of_the_formula():
    """Summed by hand at two pixels, the weights cut off at three standard deviations."""
    generator = torch.Generator().manual_seed(0)
    depth = 2.0 + torch.rand(1, 1, 48, 64, generator=generator)
    points = point_grid()
    found = SparseError()(wall_view(depth, points=points))[0]
    rows, columns = torch.nonzero(points[0, 0], as_tuple=True)
    errors = (depth[0, 0, rows, columns] - 2.0).abs()
    sigma = 0.5 * (48 * 64 / len(errors)) ** 0.5
    for row, column in ((20, 31), (24, 40)):
        near = ((rows - row).abs() <= round(3 * sigma)) & ((columns - column).abs() <= round(3 * sigma))
        weights = near * torch.exp(-((rows - row) ** 2 + (columns - column) ** 2) / (2.0 * sigma**2))
        expected = (weights @ errors + PRIOR_WEIGHT * errors.mean()) / (weights.sum() + PRIOR_WEIGHT)
        assert found[row, column].item() == pytest.approx(expected.item(), rel=0.01)


def test_a_pixel_takes_the_error_of_the_points_around_it():
    """The prediction is right on the left half and half a metre too far on the right."""
    depth = torch.full((1, 1, 48, 64), 2.0)
    depth[..., 32:] = 2.5
    uncertainty = SparseError()(wall_view(depth, points=point_grid()))[0]
    assert uncertainty[:, :16].max() < 0.02
    assert uncertainty[:, 48:].min() > 0.48
    assert (uncertainty[:, 1:] >= uncertainty[:, :-1] - 0.02).all()  # from one to the other between them


def test_relative_errors_do_not_grow_with_the_distance():
    """The prediction is a tenth too far everywhere, of a wall at two metres on the left and at six on the right."""
    view = wall_view(torch.full((1, 1, 48, 64), 2.2), points=point_grid())
    for part in (view.depth, view.sparse_depth):
        part[..., 32:] *= 3.0
    torch.testing.assert_close(SparseError(relative=True)(view)[0], torch.full((48, 64), 0.1))
    metres = SparseError()(view)[0]
    assert metres[:, 60:].min() > 2.5 * metres[:, :4].max()


def test_far_from_all_points_it_is_their_mean():
    points = torch.zeros(1, 1, 48, 64, dtype=torch.bool)
    points[..., 2:8, 2:8] = True
    depth = torch.full((1, 1, 48, 64), 2.0)
    depth[..., 2:8, 2:5] = 3.0  # half of the points miss by a metre
    assert SparseError()(wall_view(depth, points=points))[0, 40, 60].item() == pytest.approx(0.5, abs=0.01)


def test_without_points_it_has_no_value():
    assert SparseError()(wall_view()).isnan().all()
