import pytest
import torch

from deux_plugins.uncertainties.sparse_error import sparse_error


@pytest.fixture
def points():
    grid = torch.zeros(1, 1, 48, 64, dtype=torch.bool)
    grid[..., 4::8, 4::8] = True
    return grid


def test_a_pixel_takes_the_error_of_the_points_around_it(make_view, points):
    """The prediction is right on the left half and half a metre too far on the right."""
    depth = torch.full((1, 1, 48, 64), 2.0)
    depth[..., 32:] = 2.5
    uncertainty = sparse_error(make_view(depth, points=points))[0]
    assert uncertainty[:, :16].max() < 0.02
    assert uncertainty[:, 48:].min() > 0.48
    assert (uncertainty[:, 1:] >= uncertainty[:, :-1] - 0.02).all()  # from one to the other between them


def test_far_from_all_points_it_is_their_mean(make_view):
    points = torch.zeros(1, 1, 48, 64, dtype=torch.bool)
    points[..., 2:8, 2:8] = True
    depth = torch.full((1, 1, 48, 64), 2.0)
    depth[..., 2:8, 2:5] = 3.0  # half of the points miss by a metre
    assert sparse_error(make_view(depth, points=points))[0, 40, 60].item() == pytest.approx(0.5, abs=0.01)


def test_without_points_it_says_nothing(make_view):
    assert sparse_error(make_view()).isnan().all()


def test_frames_of_a_batch_do_not_touch_each_other(make_view, points):
    depth = torch.full((2, 1, 48, 64), 2.0)
    depth[1] = 3.0
    both = sparse_error(make_view(depth, points=points.expand(2, -1, -1, -1)))
    torch.testing.assert_close(both[0], sparse_error(make_view(depth[:1], points=points))[0])
    torch.testing.assert_close(both[1], torch.full((48, 64), 1.0))
