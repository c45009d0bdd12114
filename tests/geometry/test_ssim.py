import numpy as np
import pytest
import torch
from kornia.metrics import ssim as kornia_ssim
from scipy.ndimage import minimum_filter
from skimage.metrics import structural_similarity

from deux.errors import DeuxError
from deux.geometry import ssim as ssim_module
from deux.geometry.ssim import ssim, wholly_visible

PATHS = [ssim_module._by_rows, ssim_module._by_kornia]


@pytest.fixture(params=["as chosen", "kornia"])
def path(request, monkeypatch):
    """The computation of the device at hand, and kornia's, which is that of other devices."""
    if request.param == "kornia":
        monkeypatch.setattr(ssim_module, "_by_rows", ssim_module._by_kornia)


on_both_paths = pytest.mark.usefixtures("path")


def images(*shape: int) -> tuple[torch.Tensor, torch.Tensor]:
    generator = torch.Generator().manual_seed(0)
    image = torch.rand(shape, generator=generator)
    return image, (image + 0.3 * torch.rand(shape, generator=generator)).clamp(0, 1)


@on_both_paths
@pytest.mark.parametrize("window_size", [3, 5, 7, 11])
@pytest.mark.parametrize(("border", "padding"), [("reflect", "same"), ("valid", "valid")])
def test_gaussian_window_agrees_with_kornia(window_size, border, padding):
    image, other = images(2, 3, 24, 30)
    expected = kornia_ssim(image, other, window_size, padding=padding)
    torch.testing.assert_close(ssim(image, other, "gaussian", window_size, border), expected, atol=1e-5, rtol=0)


@pytest.mark.parametrize("window", ["gaussian", "box"])
@pytest.mark.parametrize("window_size", [3, 5, 7, 11])
@pytest.mark.parametrize("border", ["reflect", "valid"])
def test_both_computations_agree_in_values_and_gradients(window, window_size, border):
    """One image against two: the mean and the gradient of what is broadcast, too; the outcome's weights are random."""
    image, others = images(2, 1, 3, 24, 30)[0].double(), images(2, 2, 3, 24, 30)[1].double()
    outcomes = []
    for compare in PATHS:
        inputs = [x.clone().requires_grad_() for x in (image, others)]
        values = compare(*inputs, window, window_size, border)
        weights = torch.rand(values.shape, generator=torch.Generator().manual_seed(1)).double()
        outcomes.append([values, *torch.autograd.grad((values * weights).sum(), inputs)])
    for ours, kornias in zip(*outcomes, strict=True):
        torch.testing.assert_close(ours, kornias, atol=1e-9, rtol=1e-9)


@on_both_paths
@pytest.mark.parametrize(("border", "largest"), [("reflect", 13), ("valid", 7)])
def test_a_window_is_refused_from_where_the_images_are_too_small(border, largest):
    image, other = images(1, 3, 7, 12)
    assert torch.isfinite(ssim(image, other, "box", largest, border)).all()
    with pytest.raises(
        DeuxError, match=f"of {largest + 2} pixels is too large for .* 12 x 7: the maximum is {largest}"
    ):
        ssim(image, other, "box", largest + 2, border)


@on_both_paths
def test_black_images_are_equal():
    black = torch.zeros(1, 3, 8, 9)
    torch.testing.assert_close(ssim(black, black), torch.ones(1, 3, 8, 9))


@on_both_paths
@pytest.mark.parametrize("window", ["gaussian", "box"])
def test_half_precision_and_autocast_do_not_reach_the_comparison(window):
    image, other = (x.bfloat16() for x in images(2, 3, 24, 30))
    expected = ssim(image.float(), other.float(), window)
    with torch.autocast("cpu", torch.bfloat16):
        similarity = ssim(image, other, window)
    assert similarity.dtype == torch.float32
    assert torch.equal(similarity, expected)


@pytest.mark.gpu
@pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a GPU")
@pytest.mark.parametrize("window", ["gaussian", "box"])
def test_a_gpu_gives_the_values_of_the_cpu(window):
    image, other = images(2, 3, 24, 30)
    similarity = ssim(image.cuda(), other.cuda(), window)
    torch.testing.assert_close(similarity.cpu(), ssim(image, other, window), atol=5e-5, rtol=0)


@on_both_paths
@pytest.mark.parametrize("window_size", [3, 7])
def test_box_window_agrees_with_scikit_image(window_size):
    image, other = (x[0, 0].double().numpy() for x in images(1, 1, 24, 30))
    _, expected = structural_similarity(
        image, other, win_size=window_size, data_range=1.0, full=True, use_sample_covariance=False
    )
    margin = window_size // 2
    similarity = ssim(torch.tensor(image)[None, None], torch.tensor(other)[None, None], "box", window_size, "valid")
    np.testing.assert_allclose(similarity[0, 0], expected[margin:-margin, margin:-margin], atol=1e-9)


@on_both_paths
@pytest.mark.parametrize("border", ["reflect", "valid"])
def test_one_image_against_several(border):
    image, others = images(2, 3, 16, 18)[0], images(2, 4, 3, 16, 18)[1]
    together = ssim(image[:, None], others, border=border)
    for index in range(4):
        torch.testing.assert_close(together[:, index], ssim(image, others[:, index], border=border))


@on_both_paths
def test_gradients():
    image, other = (x.double() for x in images(1, 1, 6, 7))
    assert torch.autograd.gradcheck(lambda x: ssim(image, x), other.requires_grad_())


def test_a_pixel_is_wholly_visible_where_its_neighbourhood_is():
    visible = torch.rand(2, 3, 20, 22, generator=torch.Generator().manual_seed(0)) > 0.1
    expected = minimum_filter(visible.numpy(), size=(1, 1, 5, 5), mode="constant", cval=True)
    np.testing.assert_array_equal(wholly_visible(visible, 5).numpy(), expected)
