import numpy as np
import pytest
import torch

from deux.environment.egocentric import Crops
from deux.policies.network import FEATURES, MapEncoder, PolicyNetwork


def view(pixels, count=3, seed=0):
    generator = torch.Generator().manual_seed(seed)
    crops = {name: torch.rand(count, 4, pixels, pixels, generator=generator) for name in ("near", "far")}
    return {**crops, "body": torch.rand(count, 4, generator=generator)}


@pytest.mark.parametrize("pixels", [8, 16, 32, 64])
def test_crops_of_any_multiple_of_eight_become_the_logits_of_three_moves(pixels):
    assert Crops(pixels=pixels).shape == (4, pixels, pixels)
    network = PolicyNetwork(pixels)
    assert network(view(pixels)).shape == (3, 3)
    assert MapEncoder(pixels)(view(pixels)).shape == (3, FEATURES)


def test_each_robot_of_a_batch_is_answered_by_itself():
    network = PolicyNetwork(16).eval()
    together = network(view(16))
    for index in range(3):
        alone = network({name: part[index : index + 1] for name, part in view(16).items()})
        torch.testing.assert_close(alone[0], together[index])


def test_everything_that_is_seen_can_matter():
    """Gradients reach every crop, channel and number of the body."""
    torch.manual_seed(0)
    seen = {name: part.requires_grad_() for name, part in view(16, count=64).items()}
    PolicyNetwork(16)(seen).square().sum().backward()
    for crop in (seen["near"], seen["far"]):
        assert (crop.grad.abs().amax(dim=(0, 2, 3)) > 0).all()
        assert (crop.grad.abs().amax(dim=(0, 1)) > 0).float().mean() > 0.9
    assert (seen["body"].grad.abs().amax(dim=0) > 0).all()


def test_it_is_small_enough_to_ship():
    """Half precision, a megabyte at most: five of them come with the package."""
    assert sum(np.prod(part.shape) for part in PolicyNetwork(Crops().pixels).parameters()) * 2 < 2**20
