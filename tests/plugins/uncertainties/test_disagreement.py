import torch

from deux_plugins.uncertainties.disagreement import flip, hidden_points


def test_flip_agrees_with_itself_where_the_model_is_symmetric(make_view):
    def model(image, sparse_depth, intrinsics):
        return image.mean(1, keepdim=True)

    assert flip(make_view(make_view().image.mean(1, keepdim=True), predict_depth=model)).max() < 1e-6


def test_flip_is_the_difference_in_metres_to_the_mirrored_answer(make_view):
    """A model that adds 1 cm for each column from the left, whatever it sees."""
    ramp = 0.01 * torch.arange(64.0).expand(1, 1, 48, 64)
    uncertainty = flip(make_view(2.0 + ramp, predict_depth=lambda image, sparse_depth, intrinsics: 2.0 + ramp))
    torch.testing.assert_close(uncertainty[0], (2.0 * ramp - 0.63)[0, 0].abs())


def test_flip_moves_the_principal_point(make_view):
    seen = []

    def model(image, sparse_depth, intrinsics):
        seen.append(intrinsics[0, 0, 2].item())
        return image[:, :1]

    view = make_view(predict_depth=model)
    view.intrinsics[:, 0, 2] = 20.0
    flip(view)
    assert seen == [43.0]
    assert view.intrinsics[0, 0, 2] == 20.0


def test_hidden_points_asks_twice_with_half_of_the_points_each(make_view):
    """A model whose depth is 10 cm for each point: all 48 say 4.8 m, either half 2.4 m."""
    points = torch.zeros(1, 1, 48, 64, dtype=torch.bool)
    points[..., 4::8, 4::8] = True

    def model(image, sparse_depth, intrinsics):
        count = (sparse_depth > 0).flatten(1).sum(1)
        return 0.1 * count[:, None, None, None].expand(-1, 1, 48, 64)

    uncertainty = hidden_points(make_view(torch.full((1, 1, 48, 64), 4.8), points=points, predict_depth=model))
    torch.testing.assert_close(uncertainty, torch.full((1, 48, 64), 2.4))
