"""ScaffNet: the suite of all depth models, and what is particular to it."""

import pytest
import torch
from torchvision.transforms import v2

from deux.contracts import DepthModel
from deux.errors import DeuxError
from deux.testing.depth_models import DepthModelSuite, camera_data
from deux_plugins.depth_models.scaffnet import ScaffNet, SpatialPyramidPool


class TestScaffNet(DepthModelSuite):
    def make_model(self) -> DepthModel:
        return ScaffNet()


class TestScaffNetWithMargin(DepthModelSuite):
    def make_model(self) -> DepthModel:
        return ScaffNet(filters=(4, 8, 8, 8, 8), decoder_filters=(8, 8, 8, 4, 4), margin=4)


def test_a_margin_is_the_network_on_points_extended_by_hand():
    model, data = ScaffNet().eval(), camera_data((40, 56))
    sparse = torch.zeros(2, 1, 50, 66)
    sparse[:, :, 5:-5, 5:-5] = data["sparse_depth"]
    extended = model.predict(torch.zeros(2, 3, 50, 66), sparse, data["intrinsics"])
    model.margin = 5
    torch.testing.assert_close(model.predict(**data), extended[..., 5:-5, 5:-5])


def test_half_of_the_training_samples_are_mirrored():
    (flip,) = ScaffNet().augmentation()
    assert isinstance(flip, v2.RandomHorizontalFlip)
    assert flip.p == 0.5


def test_it_does_not_look_at_the_image_nor_at_the_camera():
    model, data = ScaffNet().eval(), camera_data((32, 48))
    depth = model.predict(**data)
    data["image"], data["intrinsics"] = 1 - data["image"], data["intrinsics"] * torch.tensor([[[2.0], [2.0], [1.0]]])
    assert torch.equal(model.predict(**data), depth)


def test_points_beyond_the_range_lie_at_its_end():
    model, data = ScaffNet(max_depth=8.0).eval(), camera_data((32, 48), points=0.0)
    data["sparse_depth"][:, :, 10, 10] = 8.0
    depth = model.predict(**data)
    data["sparse_depth"][:, :, 10, 10] = 30.0
    assert torch.equal(model.predict(**data), depth)


def test_the_pyramid_sees_a_point_as_far_as_half_its_window():
    pool = SpatialPyramidPool((3, 7), filters=2)
    seen = []
    pool.convs[0].register_forward_pre_hook(lambda _, inputs: seen.append(inputs[0]))
    sparse_depth = torch.zeros(1, 1, 9, 9)
    sparse_depth[0, 0, 4, 4] = 2.0
    pool(sparse_depth)
    assert [int((channel == 2.0).sum()) for channel in seen[0][0]] == [1, 9, 49]


@pytest.mark.parametrize(
    ("options", "message"),
    [({"pools": (12,)}, "pools contains the window 12"), ({"decoder_filters": (8, 8)}, "decoder_filters")],
)
def test_impossible_options_are_refused(options, message):
    with pytest.raises(DeuxError, match=message):
        ScaffNet(**options)
