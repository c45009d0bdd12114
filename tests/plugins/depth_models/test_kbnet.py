"""KBNet against the published network (cases/kbnet) and the suite of all depth models."""

import numpy as np
import pytest
import torch
from scipy import stats
from torch.nn import functional

from deux.contracts import DepthModel
from deux.data.transforms import augment
from deux.errors import DeuxError
from deux.testing.depth_models import DepthModelSuite, camera_data
from deux_plugins.depth_models.kbnet import KBNet
from deux_plugins.depth_models.kbnet.rays import camera_rays


class TestKBNet(DepthModelSuite):
    def make_model(self) -> DepthModel:
        return KBNet()


class TestKBNetWithMargin(DepthModelSuite):
    def make_model(self) -> DepthModel:
        return KBNet(
            image_filters=(4, 8, 8, 8, 8), depth_filters=(4, 4, 4, 4, 4), decoder_filters=(8, 8, 8, 4, 4), margin=4
        )


def test_a_margin_is_the_network_on_an_image_extended_by_hand():
    torch.manual_seed(0)
    model, data = KBNet().eval(), camera_data((40, 56))
    image = torch.from_numpy(np.pad(data["image"].numpy(), ((0, 0), (0, 0), (5, 5), (5, 5)), mode="edge"))
    sparse = torch.zeros(2, 1, 50, 66)
    sparse[:, :, 5:-5, 5:-5] = data["sparse_depth"]
    intrinsics = data["intrinsics"].clone()
    intrinsics[:, :2, 2] += 5
    extended = model.predict(image, sparse, intrinsics)
    model.margin = 5
    torch.testing.assert_close(model.predict(**data), extended[..., 5:-5, 5:-5])


def test_training_goes_without_the_margin():
    torch.manual_seed(0)
    model, data = KBNet(margin=4), camera_data((40, 56))
    inputs = (data["image"], data["sparse_depth"], (data["sparse_depth"] > 0).float(), data["intrinsics"])
    trained = model.train()(*inputs).depth
    model.margin = 0
    torch.testing.assert_close(trained, model.eval()(*inputs).depth)


def test_a_margin_keeps_the_padding_of_the_convolutions_away_from_the_rim():
    """Without texture and points, nothing but the padding tells an outer pixel from its neighbours further in."""
    torch.manual_seed(0)
    model = KBNet().eval()
    image, sparse = torch.full((1, 3, 64, 64), 0.5), torch.zeros(1, 1, 64, 64)
    intrinsics = torch.tensor([[[32.0, 0.0, 31.5], [0.0, 32.0, 31.5], [0.0, 0.0, 1.0]]])

    def step_at_the_rim() -> float:
        row = model.predict(image, sparse, intrinsics)[0, 0, 32].log()
        return float((row[0] - row[2]).abs() + (row[-1] - row[-3]).abs())

    without = step_at_the_rim()
    model.margin = 8
    assert step_at_the_rim() < 0.5 * without


def test_number_of_parameters_with_the_kitti_pools():
    model = KBNet(min_pools=(5, 7, 9, 11, 13), max_pools=(15, 17))
    assert sum(p.numel() for p in model.parameters()) == 6_957_780


def test_a_size_that_is_no_multiple_of_anything():
    depth = KBNet().predict(**camera_data((97, 131)))
    assert depth.shape == (2, 1, 97, 131)


def test_half_of_the_training_samples_show_all_their_points():
    points = np.ones((20, 50), np.float32)
    sample = {"images": np.zeros((1, 3, 20, 50), np.uint8), "sparse_depth": points, "intrinsics": np.eye(3)}
    published = KBNet().augmentation()
    shown = [augment(sample, published, seed)["input_sparse_depth"].sum() / 1000 for seed in range(1000)]
    thinned = [left for left in shown if left < 1.0]
    assert stats.binomtest(len(thinned), 1000, 0.5).pvalue > 0.01
    assert 0.40 <= min(thinned) < 0.42
    assert 0.68 < max(thinned) <= 0.70
    assert points.all()


def test_rays_of_the_full_size_are_those_of_the_inverse_intrinsics():
    k = torch.tensor([[[50.0, 0.5, 30.0], [0.0, 60.0, 20.0], [0.0, 0.0, 1.0]]])
    rays = camera_rays(k, (40, 64), (1.0, 1.0))
    pixel = torch.tensor([17.0, 5.0, 1.0])
    torch.testing.assert_close(rays[0, :, 5, 17], torch.linalg.inv(k[0]) @ pixel)


def test_rays_of_half_the_size_are_those_of_every_second_pixel():
    k = torch.tensor([[[50.0, 0.0, 30.0], [0.0, 60.0, 20.0], [0.0, 0.0, 1.0]]])
    every_second = camera_rays(k, (40, 64), (1.0, 1.0))[..., ::2, ::2]
    torch.testing.assert_close(camera_rays(k, (20, 32), (0.5, 0.5)), every_second)


def published_rays(k: np.ndarray, size: tuple[int, int], level: int) -> np.ndarray:
    """K_l^-1 [u v 1] in float64, rows of K scaled by the ratio of level 1's size to the full size from level 1 on."""
    halved = [-(-length // 2**level) for length in size]
    ratio = [-(-length // 2) / length if level else 1.0 for length in size]
    v, u = np.mgrid[: halved[0], : halved[1]].astype(np.float64)
    pixels = np.stack([u, v, np.ones_like(u)]).reshape(3, -1)
    return (np.linalg.inv(np.diag([ratio[1], ratio[0], 1.0]) @ k) @ pixels).reshape(3, *halved)


@pytest.mark.parametrize("size", [(33, 47), (49, 83), (97, 131), (131, 97), (66, 98), (64, 96)])
def test_every_level_is_given_the_published_rays(size):
    model = KBNet(image_filters=(4,) * 5, depth_filters=(4,) * 5, decoder_filters=(4,) * 5)
    k = np.array([[0.8 * size[1], 0.3, 0.45 * size[1]], [0.0, 0.9 * size[0], 0.55 * size[0]], [0.0, 0.0, 1.0]])
    given: list[torch.Tensor] = []
    for level in range(4):
        layer = model.encoder.get_submodule(f"calibrated_backprojection{level + 1}")
        layer.register_forward_pre_hook(lambda _, inputs: given.append(inputs[2]))
    data = camera_data(size)
    model.predict(data["image"], data["sparse_depth"], torch.tensor(k).float().repeat(2, 1, 1))
    assert len(given) == 4
    for level, rays in enumerate(given):
        expected = published_rays(k, size, level)
        np.testing.assert_allclose(rays[1].numpy(), expected, atol=1e-6, rtol=0)


def test_the_camera_matters():
    model, data = KBNet().eval(), camera_data((64, 96))
    before = model.predict(**data)
    data["intrinsics"][:, 0, 0] *= 1.5
    assert (model.predict(**data) - before).abs().max() > 1e-4


def test_points_in_the_encoder_are_rays_times_depth():
    """A plane's features, backprojected at every second pixel, equal the published ones: all pixels, stride 2."""
    layer = KBNet().encoder.calibrated_backprojection1
    image, depth, rays = torch.rand(1, 48, 9, 11), torch.rand(1, 16, 9, 11), torch.rand(1, 3, 9, 11)
    _, _, fused = layer(image, depth, rays, None)
    everywhere = torch.cat([image, rays * layer.proj_depth(depth)], dim=1)
    strided = functional.conv2d(everywhere, layer.conv_fused.conv.weight, stride=2)
    torch.testing.assert_close(fused, functional.leaky_relu(strided, 0.2))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"min_depth": 3.0, "max_depth": 2.0}, "must satisfy 0 < min_depth < max_depth"),
        ({"min_pools": (15, 16)}, "min_pools contains the window 16"),
        ({"image_filters": (8, 8)}, "image_filters"),
        ({"margin": -1}, "margin=-1"),
    ],
)
def test_impossible_options_are_refused(options, message):
    with pytest.raises(DeuxError, match=message):
        KBNet(**options)
