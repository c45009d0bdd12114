"""The compiled structural similarity against scikit-image and finite differences (kornia: test_ssim.py)."""

import numpy as np
import pytest
import torch
from skimage.metrics import structural_similarity

from deux.geometry.compiled_ssim import compiled_ssim

BOX = [0.2] * 5


@pytest.fixture(params=[1, 6])
def threads(request):
    before = torch.get_num_threads()
    torch.set_num_threads(request.param)
    yield request.param
    torch.set_num_threads(before)


def images(*shape: int) -> tuple[torch.Tensor, torch.Tensor]:
    generator = torch.Generator().manual_seed(0)
    return torch.rand(shape, generator=generator), torch.rand(shape, generator=generator)


@pytest.mark.usefixtures("threads")
@pytest.mark.parametrize("planes", [1, 2, 7])
def test_threads_share_the_images(planes):
    """More images than threads, and fewer; not contiguous in memory."""
    image, other = (x.transpose(1, 2) for x in images(planes, 14, 12))
    similarity = compiled_ssim(image, other, BOX, margin=0)
    for n in range(planes):
        _, expected = structural_similarity(
            image[n].numpy(), other[n].numpy(), win_size=5, data_range=1.0, full=True, use_sample_covariance=False
        )
        np.testing.assert_allclose(similarity[n], expected[2:-2, 2:-2], atol=1e-5)


@pytest.mark.usefixtures("threads")
@pytest.mark.parametrize("margin", [0, 2])
def test_gradients_of_both_images(margin):
    """What is broadcast collects the gradients of all that it is compared with."""
    image, other = (x.double() for x in images(2, 3, 6, 7))
    image = image[:1].clone().requires_grad_()
    assert torch.autograd.gradcheck(lambda a, b: compiled_ssim(a, b, BOX, margin), (image, other.requires_grad_()))


def test_images_mirrored_up_to_their_last_row():
    image, other = images(1, 3, 8)
    mirrored = [torch.nn.functional.pad(x, [2] * 4, mode="reflect") for x in (image, other)]
    torch.testing.assert_close(compiled_ssim(image, other, BOX, 2), compiled_ssim(*mirrored, BOX, 0))
