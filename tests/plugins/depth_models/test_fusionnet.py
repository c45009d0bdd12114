"""FusionNet: the suite of all depth models, and what is particular to it."""

import numpy as np
import pytest
import torch
from torchvision.transforms import v2

from deux.configuration import compose
from deux.contracts import DepthModel
from deux.errors import DeuxError
from deux.registry import registry
from deux.testing.depth_models import DepthModelSuite, camera_data, run
from deux_plugins.depth_models.fusionnet import FusionNet, match_scale


class TestFusionNet(DepthModelSuite):
    def make_model(self) -> DepthModel:
        return FusionNet()


class TestFusionNetWithMargin(DepthModelSuite):
    def make_model(self) -> DepthModel:
        return FusionNet(
            image_filters=(4, 8, 8, 8, 8), depth_filters=(4,) * 5, decoder_filters=(8, 8, 8, 4, 4), margin=4
        )


def test_a_margin_is_the_network_on_inputs_extended_by_hand():
    model, data = FusionNet().eval(), camera_data((40, 56))
    image = torch.from_numpy(np.pad(data["image"].numpy(), ((0, 0), (0, 0), (5, 5), (5, 5)), mode="edge"))
    sparse = torch.zeros(2, 1, 50, 66)
    sparse[:, :, 5:-5, 5:-5] = data["sparse_depth"]
    extended = run(model, {"image": image, "sparse_depth": sparse, "intrinsics": data["intrinsics"]})
    model.margin = 5
    prediction = run(model, data)
    torch.testing.assert_close(prediction.depth, extended.depth[..., 5:-5, 5:-5])
    torch.testing.assert_close(prediction.extras["prior"], extended.extras["prior"][..., 5:-5, 5:-5])


def test_training_goes_without_the_margin():
    model, data = FusionNet(margin=4), camera_data((40, 56))
    trained = run(model.train(), data).depth
    model.margin = 0
    torch.testing.assert_close(trained, run(model.eval(), data).depth)


def test_half_of_the_training_samples_are_mirrored():
    (flip,) = FusionNet().augmentation()
    assert isinstance(flip, v2.RandomHorizontalFlip)
    assert flip.p == 0.5


def test_scaffnet_is_frozen_whatever_the_mode():
    model = FusionNet().train()
    assert model.training
    assert not any(module.training for module in model.scaffnet.modules())
    before = {name: value.clone() for name, value in model.scaffnet.state_dict().items()}
    prediction = run(model, camera_data((32, 48)))
    prediction.depth.sum().backward()
    assert all(parameter.grad is None for parameter in model.scaffnet.parameters())
    after = model.scaffnet.state_dict()
    assert all(torch.equal(after[name], value) for name, value in before.items())


def test_the_prior_is_what_scaffnet_predicts():
    model, data = FusionNet().eval(), camera_data((32, 48))
    assert torch.equal(run(model, data).extras["prior"], model.scaffnet.predict(**data))


def test_its_foundation_is_a_scaffnet_of_the_same_options():
    options = {"scaffnet_filters": (4, 4, 8, 8, 8), "scaffnet_pools": (5, 7), "max_depth": 6.0}
    foundation = FusionNet(**options).foundation()
    made = registry().create("depth_models", foundation.name, foundation.settings)
    assert made.max_depth == 6.0
    foundation.module.load_state_dict(made.state_dict())
    with torch.device("meta"):
        assert FusionNet().foundation().module.spatial_pyramid_pool.windows == (13, 17, 19, 21, 25)


def test_scaffnet_has_a_range_of_its_own():
    """A published checkpoint holds a ScaffNet of 0.1 to 10 m in a FusionNet of 0.1 to 8 m."""
    model, data = FusionNet(max_depth=8.0, scaffnet_max_depth=10.0).eval(), camera_data((32, 48))
    foundation = model.foundation()
    scaffnet = registry().create("depth_models", foundation.name, foundation.settings).eval()
    assert (scaffnet.min_depth, scaffnet.max_depth, model.max_depth) == (0.1, 10.0, 8.0)
    scaffnet.load_state_dict(foundation.module.state_dict())
    assert torch.equal(run(model, data).extras["prior"], scaffnet.predict(**data))
    own = FusionNet(max_depth=8.0).scaffnet.eval()
    own.load_state_dict(scaffnet.state_dict())
    assert not torch.equal(own.predict(**data), scaffnet.predict(**data))


@pytest.mark.parametrize("bounds", [{"scaffnet_min_depth": 12.0}, {"scaffnet_max_depth": 0.05}], ids=str)
def test_a_range_of_scaffnets_that_is_none(bounds):
    with pytest.raises(DeuxError, match="must satisfy 0 < scaffnet_min_depth < scaffnet_max_depth"):
        FusionNet(**bounds)


def test_the_published_trainings_make_one_scaffnet():
    """`experiment=published_fusionnet` is built on what `experiment=published_scaffnet` trains."""
    alone, above = (
        registry().choose("depth_models", compose([f"experiment=published_{name}"]).model)
        for name in ("scaffnet", "fusionnet")
    )
    foundation = above.create().foundation()
    inside = registry().choose("depth_models", {"name": foundation.name, **foundation.settings})
    assert inside == alone


def test_scale_is_matched_around_each_point_only():
    depth = torch.full((1, 1, 9, 20), 2.0)
    points = torch.zeros_like(depth)
    points[0, 0, 4, 3], points[0, 0, 4, 10], points[0, 0, 4, 16] = 3.0, 1.0, 4.1  # the last is too far to be believed
    scaled = match_scale(depth, points, window=5)
    expected = depth.clone()
    expected[0, 0, 2:7, 1:6], expected[0, 0, 2:7, 8:13] = 3.0, 1.0
    torch.testing.assert_close(scaled, expected)


def test_where_windows_overlap_the_greater_factor_counts():
    depth, points = torch.ones(1, 1, 1, 5), torch.tensor([[[[0.0, 1.5, 0.0, 0.5, 0.0]]]])
    torch.testing.assert_close(match_scale(depth, points, 3), torch.tensor([[[[1.5, 1.5, 1.5, 0.5, 0.5]]]]))


def test_outliers_set_no_scale():
    """FusionNet's own inputs hold the filtered points, where ScaffNet sees all of them."""
    model, data = FusionNet().eval(), camera_data((32, 48))
    validity = torch.zeros_like(data["sparse_depth"])
    seen = []
    model.encoder_depth.register_forward_pre_hook(lambda _, inputs: seen.append(inputs[0]))
    prediction = model(**data, validity=validity)
    assert torch.equal(seen[0][:, :1], prediction.extras["prior"])
    assert not seen[0][:, 1:].any()


@pytest.mark.parametrize("window", [4, 0, -1])
def test_a_window_without_a_centre_is_refused(window):
    with pytest.raises(
        DeuxError, match=rf"model\.scale_window contains the window {window}: windows must be odd numbers"
    ):
        FusionNet(scale_window=window)
