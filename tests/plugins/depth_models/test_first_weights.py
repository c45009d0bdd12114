import math

import pytest
import torch

from deux.contracts import DepthModel
from deux.registry import registry
from deux_plugins.depth_models.parts.first_weights import first_depth


def kbnet(seed: int = 0, **options: object) -> DepthModel:
    torch.manual_seed(seed)
    model: DepthModel = registry().create("depth_models", "kbnet", options)
    return model


def predicted(model: DepthModel, size: int) -> torch.Tensor:
    """Depth of a slanted plane with 1 % of its points and a striped image, on which the start was not measured."""
    rows, columns = torch.meshgrid(torch.arange(size) / size, torch.arange(size) / size, indexing="ij")
    image = (0.5 + 0.5 * torch.sin(20.0 * columns + 7.0 * rows)).expand(1, 3, size, size).contiguous()
    depth = (1.0 + 3.0 * rows)[None, None]
    points = torch.where(torch.rand(depth.shape, generator=torch.Generator().manual_seed(1)) < 0.01, depth, 0.0)
    camera = torch.tensor([[[size / 2, 0.0, size / 2], [0.0, size / 2, size / 2], [0.0, 0.0, 1.0]]])
    with torch.no_grad():
        return model.eval().predict(image, points, camera)


@pytest.mark.parametrize("size", [64, 128])
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_the_first_prediction_lies_in_the_room(seed, size):
    assert 1.0 < predicted(kbnet(seed, first_weights="he"), size).median().item() < 6.0
    assert predicted(kbnet(seed), size).median().item() == pytest.approx(0.2, abs=0.03)


def test_a_layer_keeps_the_size_of_its_features():
    model = kbnet(first_weights="he")
    weights = [m.weight for m in model.modules() if isinstance(m, torch.nn.Conv2d) and m.weight.numel() > 20_000]
    assert len(weights) > 10
    for weight in weights:
        fan_in = weight[0].numel()
        assert weight.std().item() == pytest.approx(math.sqrt(2.0 / (1.04 * fan_in)), rel=0.05)


def test_one_seed_gives_one_start():
    one, same, other = (kbnet(seed, first_weights="he").state_dict() for seed in (0, 0, 1))
    assert all(torch.equal(one[name], same[name]) for name in one)
    assert not all(torch.equal(one[name], other[name]) for name in one)


def test_a_new_model_is_ready_for_training():
    assert kbnet(first_weights="he").training


def test_a_model_without_weights_is_left_alone():
    with torch.device("meta"):
        assert next(kbnet(first_weights="he").parameters()).is_meta


@pytest.mark.parametrize(("nearest", "farthest"), [(0.1, 10.0), (0.1, 8.0), (0.5, 1.0), (1.0, 80.0)])
def test_the_first_depth_lies_in_the_range(nearest, farthest):
    assert nearest < first_depth(kbnet(min_depth=nearest, max_depth=farthest)) < farthest
