import torch

from deux.geometry.photometric_residual import photometric_residual


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
