import numpy as np
import pytest
import torch
from scipy.optimize import least_squares

from deux.testing.host_waits import refuse_host_waits
from deux_depth_anything.alignment import TYPICAL_DEPTH, align

RANGE = (0.1, 20.0)


def frames(count: int = 3, points: float = 0.05, seed: int = 0) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """Inverse depth up to scale and shift, the true depth, and the places of points."""
    generator = torch.Generator().manual_seed(seed)
    relative = 1.0 + 4.0 * torch.rand(count, 1, 32, 48, generator=generator)
    scale, shift = torch.rand(2, count, 1, 1, 1, generator=generator) * 0.2 + 0.05
    return relative, 1.0 / (scale * relative + shift), torch.rand(relative.shape, generator=generator) < points


def test_scale_and_shift_are_found() -> None:
    relative, truth, places = frames()
    sparse = torch.where(places, truth, 0.0)
    torch.testing.assert_close(align(relative, sparse, places.float(), RANGE), truth, rtol=1e-4, atol=1e-4)


def test_a_fifth_of_wrong_points_changes_little() -> None:
    relative, truth, places = frames()
    wrong = places & (torch.rand(places.shape, generator=torch.Generator().manual_seed(1)) < 0.2)
    sparse = torch.where(places, torch.where(wrong, 0.3 * truth, truth), 0.0)
    torch.testing.assert_close(align(relative, sparse, places.float(), RANGE), truth, rtol=0.02, atol=0.02)


def test_points_that_do_not_count_are_left_out() -> None:
    relative, truth, places = frames()
    half = places & (torch.arange(48) < 24)
    sparse = torch.where(half, truth, torch.where(places, 9.0, 0.0))
    torch.testing.assert_close(align(relative, sparse, half.float(), RANGE), truth, rtol=1e-4, atol=1e-4)


def test_it_is_the_cauchy_estimate_of_scipy() -> None:
    relative, truth, places = frames(count=1)
    noise = 0.02 * torch.randn(truth.shape, generator=torch.Generator().manual_seed(2))
    sparse = torch.where(places, 1.0 / (1.0 / truth + noise).clamp(min=0.05), 0.0)
    depth = align(relative, sparse, places.float(), RANGE)
    r, target = relative[places].double().numpy(), 1.0 / sparse[places].double().numpy()

    def residuals(x: np.ndarray) -> np.ndarray:
        return x[0] * r + x[1] - target

    start = least_squares(residuals, [0.1, 0.1]).x
    width = 2.385 * 1.4826 * np.median(np.abs(residuals(start)))
    scale, shift = least_squares(residuals, start, loss="cauchy", f_scale=width).x
    torch.testing.assert_close(depth, 1.0 / (scale * relative + shift).float(), rtol=0.02, atol=0.02)


@pytest.mark.parametrize("value", [0.0, 3.0])
def test_a_single_point_or_an_image_of_one_value_gives_the_scale(value: float) -> None:
    relative, _, _ = frames(count=1)
    sparse = torch.zeros_like(relative)
    sparse[..., 5, 7] = 2.5
    depth = align(relative, sparse, (sparse > 0).float(), RANGE)
    assert depth[..., 5, 7].item() == pytest.approx(2.5, rel=1e-3)
    torch.testing.assert_close(depth, 2.5 * relative[..., 5, 7] / relative, rtol=1e-3, atol=1e-3)
    flat = align(torch.full_like(relative, value), sparse, (sparse > 0).float(), RANGE)
    torch.testing.assert_close(flat, torch.full_like(flat, 2.5), rtol=1e-3, atol=1e-3)


def test_near_stays_near_where_the_points_say_otherwise() -> None:
    relative, _, places = frames(count=1)
    sparse = torch.where(places, relative, 0.0)  # farther where the network says nearer
    depth = align(relative, sparse, places.float(), RANGE)
    order = relative.flatten().argsort()
    assert (depth.flatten()[order].diff() <= 0).all()


def test_without_points_the_median_is_typical_or_that_of_a_metric_network() -> None:
    relative, _, _ = frames(count=2)
    nothing = torch.zeros_like(relative)
    assert align(relative, nothing, nothing, RANGE).flatten(1).median(1).values.tolist() == pytest.approx(
        [TYPICAL_DEPTH] * 2,
        rel=0.01,  # torch's median is the lower of two values
    )
    torch.testing.assert_close(align(relative, nothing, nothing, RANGE, metric=True), 1.0 / relative)


def test_the_host_does_not_wait() -> None:
    relative, truth, places = frames()
    relative.requires_grad_()
    with refuse_host_waits():
        align(relative, torch.where(places, truth, 0.0), places.float(), RANGE).sum().backward()
