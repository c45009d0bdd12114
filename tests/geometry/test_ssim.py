import numpy as np
import pytest
import torch
from kornia.metrics import ssim as kornia_ssim
from scipy.ndimage import minimum_filter
from skimage.metrics import structural_similarity

from deux.geometry.ssim import ssim, wholly_visible


def images(*shape: int) -> tuple[torch.Tensor, torch.Tensor]:
    generator = torch.Generator().manual_seed(0)
    image = torch.rand(shape, generator=generator)
    return image, (image + 0.3 * torch.rand(shape, generator=generator)).clamp(0, 1)


@pytest.mark.parametrize("window_size", [3, 7, 11])
@pytest.mark.parametrize(("border", "padding"), [("reflect", "same"), ("valid", "valid")])
def test_gaussian_window_agrees_with_kornia(window_size, border, padding):
    image, other = images(2, 3, 24, 30)
    expected = kornia_ssim(image, other, window_size, padding=padding)
    torch.testing.assert_close(ssim(image, other, "gaussian", window_size, border), expected, atol=2e-5, rtol=0)


@pytest.mark.parametrize("window_size", [3, 7])
def test_box_window_agrees_with_scikit_image(window_size):
    image, other = (x[0, 0].double().numpy() for x in images(1, 1, 24, 30))
    _, expected = structural_similarity(
        image, other, win_size=window_size, data_range=1.0, full=True, use_sample_covariance=False
    )
    margin = window_size // 2
    similarity = ssim(torch.tensor(image)[None, None], torch.tensor(other)[None, None], "box", window_size, "valid")
    np.testing.assert_allclose(similarity[0, 0], expected[margin:-margin, margin:-margin], atol=1e-9)


@pytest.mark.parametrize("border", ["reflect", "valid"])
def test_one_image_against_several(border):
    image, others = images(2, 3, 16, 18)[0], images(2, 4, 3, 16, 18)[1]
    together = ssim(image[:, None], others, border=border)
    for index in range(4):
        torch.testing.assert_close(together[:, index], ssim(image, others[:, index], border=border))


def test_gradients():
    image, other = (x.double() for x in images(1, 1, 6, 7))
    assert torch.autograd.gradcheck(lambda x: ssim(image, x), other.requires_grad_())


def test_a_pixel_is_wholly_visible_where_its_neighbourhood_is():
    visible = torch.rand(2, 3, 20, 22, generator=torch.Generator().manual_seed(0)) > 0.1
    expected = minimum_filter(visible.numpy(), size=(1, 1, 5, 5), mode="constant", cval=True)
    np.testing.assert_array_equal(wholly_visible(visible, 5).numpy(), expected)
