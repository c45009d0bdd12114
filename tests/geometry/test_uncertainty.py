import math

import pytest
import torch

from deux.geometry.uncertainty import photometric_residual, uncertainty


def frames() -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """A grey image and two reconstructions: 0.1 too bright in one channel of the first, 0.3 too dark in the second."""
    image = torch.full((1, 3, 8, 10), 0.5)
    reconstructions = image[:, None].repeat(1, 2, 1, 1, 1)
    reconstructions[:, 0, 0] += 0.1
    reconstructions[:, 1] -= 0.3
    return image, reconstructions, torch.ones(1, 2, 1, 8, 10, dtype=torch.bool)


def test_residual_is_the_mean_over_the_frames_that_see_a_pixel():
    image, reconstructions, visible = frames()
    visible[:, 0, :, :, :2] = False
    visible[:, 1, :, :, 8:] = False
    visible[:, :, :, 0] = False
    residual = photometric_residual(image, reconstructions, visible)
    assert residual.shape == (1, 8, 10)
    assert residual[0, 0].isnan().all()
    torch.testing.assert_close(residual[0, 1:, :2], torch.full((7, 2), 0.3))
    torch.testing.assert_close(residual[0, 1:, 8:], torch.full((7, 2), 0.1 / 3))
    torch.testing.assert_close(residual[0, 1:, 2:8], torch.full((7, 6), (0.3 + 0.1 / 3) / 2))


def test_uncertainty_is_equation_eight():
    image, reconstructions, visible = frames()
    expected = 1.0 - math.exp(-(0.3 + 0.1 / 3) / 2)
    assert uncertainty(image, reconstructions, visible).item() == pytest.approx(expected, rel=1e-5)


@pytest.mark.parametrize("metric", ["l1", "ssim"])
def test_uncertainty_of_a_perfect_and_of_an_invisible_frame(metric):
    image = torch.rand(2, 3, 8, 10, generator=torch.Generator().manual_seed(0))
    visible = torch.ones(2, 2, 1, 8, 10, dtype=torch.bool)
    visible[1] = False
    value = uncertainty(image, image[:, None].repeat(1, 2, 1, 1, 1), visible, metric)
    assert value[0].item() == pytest.approx(0.0, abs=1e-5)
    assert value[1].isnan()


def test_ssim_metric_ignores_a_neighbourhood_that_is_partly_invisible():
    image = torch.rand(1, 3, 9, 9, generator=torch.Generator().manual_seed(0))
    reconstructions, visible = image[:, None].clone(), torch.ones(1, 1, 1, 9, 9, dtype=torch.bool)
    reconstructions[..., 4, 4], visible[..., 4, 4] = 0.0, False
    residual = photometric_residual(image, reconstructions, visible, "ssim")
    assert residual[0, 3:6, 3:6].isnan().all()
    assert residual.nanmean() < 1e-5


def test_ssim_metric_lies_between_zero_and_one():
    generator = torch.Generator().manual_seed(0)
    image, other = (
        torch.rand(1, 3, 8, 10, generator=generator),
        torch.rand(1, 1, 3, 8, 10, generator=generator),
    )
    residual = photometric_residual(image, other, torch.ones(1, 1, 1, 8, 10, dtype=torch.bool), "ssim")
    assert 0.2 < residual.mean() < 0.8
    assert residual.min() >= 0
    assert residual.max() <= 1
