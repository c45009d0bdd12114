"""The parts of the published depth models against other ways to compute the same."""

import subprocess
import sys

import pytest
import torch
from scipy.spatial.transform import Rotation
from torch.nn import functional

from deux.inference.prediction import prepared_inputs
from deux.registry import registry
from deux_plugins.depth_models.parts.convolution import Convolution, ConvolutionBlock
from deux_plugins.depth_models.parts.decoder import Decoder, UpConvolution, convolve_to_few_channels
from deux_plugins.depth_models.parts.depth_range import depth_from_logits, nearness_from_logits, recoverable_clamp
from deux_plugins.depth_models.parts.pooling import sliding_min_of_points
from deux_plugins.depth_models.parts.pose_matrix import pose_matrix, rotation_matrix
from deux_plugins.depth_models.parts.pose_network import seven_convolution_pose_network
from deux_plugins.depth_models.parts.small_map_convolution import convolve_small_map, is_small_map


def test_sliding_min_sees_points_only():
    sparse_depth = torch.zeros(1, 1, 9, 9)
    sparse_depth[0, 0, 4, 4], sparse_depth[0, 0, 4, 5] = 3.0, 2.0
    nearest = sliding_min_of_points(sparse_depth, 3)[0, 0]
    assert nearest[4, 4] == nearest[3, 6] == 2.0
    assert nearest[4, 3] == 3.0
    assert nearest[0, 0] == 0.0


@pytest.mark.parametrize("size", [(6, 10), (12, 14), (48, 50)])
def test_doubling_equals_enlarging_then_convolving(size):
    layer = UpConvolution(5, 4)
    x = torch.randn(2, 5, *size)
    height, width = size
    expected = layer.conv(functional.interpolate(x, scale_factor=2.0))
    torch.testing.assert_close(layer(x, (2 * height, 2 * width)), expected, rtol=1e-5, atol=1e-5)


def test_enlarging_to_an_odd_size():
    assert UpConvolution(5, 4)(torch.randn(1, 5, 48, 50), (95, 99)).shape == (1, 4, 95, 99)


@pytest.mark.parametrize("channels", [1, 2])
def test_a_convolution_to_few_channels_is_that_of_torch(channels):
    """In values and in both gradients."""
    torch.manual_seed(0)
    x = torch.randn(2, 12, 7, 10, dtype=torch.float64).to(memory_format=torch.channels_last).requires_grad_()
    weight = torch.randn(channels, 12, 3, 3, dtype=torch.float64, requires_grad=True)
    above = torch.randn(2, channels, 7, 10, dtype=torch.float64)
    outcomes = []
    for result in (convolve_to_few_channels(x, weight), functional.conv2d(x, weight, padding=1)):
        outcomes.append([result, *torch.autograd.grad(result, (x, weight), above)])
    for ours, theirs in zip(*outcomes, strict=True):
        torch.testing.assert_close(ours, theirs)


def test_a_decoder_gives_the_same_in_training_and_in_evaluation():
    torch.manual_seed(0)
    decoder = Decoder(8, [0], [6], out_channels=2)
    latent = torch.randn(1, 8, 5, 6)
    trained, evaluated = (decoder.train(mode)(latent, [()], [(10, 12)]) for mode in (True, False))
    torch.testing.assert_close(trained, evaluated)


def test_a_decoder_ends_in_the_convolution_of_its_output_layer():
    torch.manual_seed(0)
    decoder, latent = Decoder(8, [0], [6], out_channels=2).eval(), torch.randn(1, 8, 5, 6)
    features = decoder.get_submodule("deconv4")(latent, (), (10, 12))
    seen = []
    decoder.output.register_forward_hook(lambda layer, inputs, output: seen.append((inputs[0], output)))
    result = decoder(latent, [()], [(10, 12)])
    ((given, found),) = seen
    assert torch.equal(given, features)
    assert found is result


def test_last_convolution_of_a_block_has_the_stride():
    block = ConvolutionBlock(3, 8, convolutions=2, stride=2)
    assert [layer.conv.stride for layer in block.conv_block] == [(1, 1), (2, 2)]
    assert block(torch.rand(1, 3, 9, 11)).shape == (1, 8, 5, 6)


def test_depth_covers_the_range():
    depth = depth_from_logits(torch.tensor([-100.0, 0.0, 100.0]), 0.1, 10.0)
    torch.testing.assert_close(depth, torch.tensor([10.0, 0.1 / 0.51, 0.1 / 1.01]))


def test_the_gradient_is_the_sigmoids_but_for_the_ends_where_it_does_not_vanish():
    def gradient(nearness, logits):
        (found,) = torch.autograd.grad(nearness(logits.requires_grad_()).sum(), logits)
        return found

    between = torch.linspace(-7.0, 2.9, 100)
    assert torch.equal(gradient(nearness_from_logits, between), gradient(torch.sigmoid, between))
    beyond = torch.tensor([-1000.0, -20.0, 20.0, 1000.0])
    assert torch.equal(nearness_from_logits(beyond), torch.sigmoid(beyond))
    ends = torch.tensor([5e-4, 5e-4, 0.95, 0.95])
    torch.testing.assert_close(gradient(nearness_from_logits, beyond), ends * (1 - ends))


def test_what_left_the_range_is_led_back_into_it_and_no_further_out():
    values = torch.tensor([-3.0, -3.0, 0.6, 0.6, 1.0, 1.9, 1.9, 7.0, 7.0], requires_grad=True)
    upstream = torch.tensor([-1.5, 1.5, -1.5, 1.5, -1.5, 1.5, -1.5, 1.5, -1.5])
    clamped = recoverable_clamp(values, 0.5, 2.0)
    assert torch.equal(clamped, values.clamp(0.5, 2.0))
    (found,) = torch.autograd.grad(clamped, values, upstream)
    inside = (values > 0.5) & (values < 2.0)
    (plain,) = torch.autograd.grad(values.clamp(0.5, 2.0), values, upstream)
    assert torch.equal(found[inside], plain[inside])
    # A step against the gradient makes what is too low higher, and what is too high lower.
    assert found[~inside].tolist() == [-1.5, 0.0, 1.5, 0.0]
    with torch.no_grad():
        assert torch.equal(recoverable_clamp(values, 0.5, 2.0), clamped)


SMALL = {
    "kbnet": {"image_filters": (4, 8, 8, 8, 8), "depth_filters": (4,) * 5, "decoder_filters": (8, 8, 8, 8, 4)},
    "voiced": {"image_filters": (4, 8, 8, 8, 8), "depth_filters": (4,) * 5, "decoder_filters": (8,) * 4},
    "scaffnet": {"filters": (4, 4, 8, 8, 8), "decoder_filters": (8, 8, 8, 8, 4)},
    "fusionnet": {
        "image_filters": (4, 8, 8, 8, 8),
        "depth_filters": (4,) * 5,
        "decoder_filters": (8, 8, 8, 8, 4),
        "scaffnet_filters": (4, 4, 8, 8, 8),
        "scaffnet_decoder_filters": (8, 8, 8, 8, 4),
    },
}


@pytest.mark.parametrize(("dtype", "tolerance"), [(torch.float64, 1e-5), (torch.float16, 1e-2), (torch.bfloat16, 5e-2)])
@pytest.mark.parametrize("margin", [0, 4])
@pytest.mark.parametrize("model", SMALL)
def test_a_network_is_converted_as_a_whole(model, margin, dtype, tolerance):
    """In evaluation; depth is at least float32."""
    torch.manual_seed(0)
    network = registry().create("depth_models", model, {**SMALL[model], "margin": margin}).eval()
    points = torch.where(torch.rand(2, 1, 64, 64) < 0.05, 2.0, 0.0)
    intrinsics = torch.tensor([[32.0, 0.0, 31.5], [0.0, 32.0, 31.5], [0.0, 0.0, 1.0]]).expand(2, 3, 3)
    inputs = (torch.rand(2, 3, 64, 64), points, (points > 0).float(), intrinsics)
    prepared = prepared_inputs(network, points)
    with torch.no_grad():
        expected = network(*inputs, **prepared).depth
        converted = {name: value.to(dtype) for name, value in prepared.items()}
        depth = network.to(dtype)(*(x.to(dtype) for x in inputs), **converted).depth
    assert depth.dtype == torch.promote_types(dtype, torch.float32)
    torch.testing.assert_close(depth.float(), expected, rtol=tolerance, atol=0.0)


NEAR_END = {"kbnet": 0.1 / 1.01, "voiced": 0.1 / 1.01, "scaffnet": 0.1 / 1.01, "fusionnet": 0.1}
"""Of the models that end in a sigmoid it lies slightly below the nearest depth; FusionNet's is clamped to that."""


@pytest.mark.parametrize("model", SMALL)
def test_a_saturated_network_comes_back(model):
    """All depth is at the near end, far beyond where the published output has a gradient: the points pull it back."""
    torch.manual_seed(0)
    network = registry().create("depth_models", model, SMALL[model]).train()
    shift = -20.0 if model == "fusionnet" else 20.0  # metres; nearness
    network.decoder.register_forward_hook(lambda decoder, inputs, output: output + shift)
    truth = torch.full((1, 1, 64, 64), 2.0)
    points = torch.where(torch.rand_like(truth) < 0.05, truth, 0.0)
    intrinsics = torch.tensor([[[32.0, 0.0, 31.5], [0.0, 32.0, 31.5], [0.0, 0.0, 1.0]]])
    inputs = (torch.rand(1, 3, 64, 64), points, (points > 0).float(), intrinsics)
    prepared = prepared_inputs(network, points)
    optimizer = torch.optim.Adam(network.parameters(), 3e-2)
    depths = []
    for _ in range(100):
        depth = network(*inputs, **prepared).depth
        optimizer.zero_grad()
        (depth - truth).abs()[points > 0].mean().backward()
        optimizer.step()
        depths.append(float(depth.detach().mean()))
    assert depths[0] == pytest.approx(NEAR_END[model], rel=1e-4)
    assert max(depths) > 0.15


def test_rotations_are_those_of_scipy():
    vectors = torch.cat([torch.randn(50, 3), 1e-4 * torch.randn(50, 3), torch.zeros(1, 3)]).double()
    expected = torch.from_numpy(Rotation.from_rotvec(vectors.numpy()).as_matrix())
    torch.testing.assert_close(rotation_matrix(vectors), expected, rtol=1e-9, atol=1e-12)


def test_gradient_of_a_rotation():
    vectors = torch.randn(4, 3, dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(rotation_matrix, vectors)
    still = torch.zeros(1, 3, requires_grad=True)
    rotation_matrix(still)[0, 2, 1].backward()
    assert torch.equal(still.grad, torch.tensor([[1.0, 0.0, 0.0]]))


def test_pose_rotates_before_it_translates():
    pose = pose_matrix(torch.tensor([[0.0, 0.0, torch.pi / 2, 1.0, 2.0, 3.0]]))
    moved = pose @ torch.tensor([1.0, 0.0, 0.0, 1.0])
    torch.testing.assert_close(moved, torch.tensor([[1.0, 3.0, 3.0, 1.0]]))


def test_poses_are_exact_where_the_networks_compute_in_bfloat16():
    vector = torch.tensor([[0.1, -0.2, 0.3, 1.0, 2.0, 3.0]])
    with torch.autocast("cpu", torch.bfloat16):
        pose = pose_matrix(vector)
    assert pose.dtype == torch.float32
    assert torch.equal(pose, pose_matrix(vector))


@pytest.mark.parametrize("name", ["voiced", "fusionnet"])
def test_seven_convolution_pose_network_is_the_published_one(published_case, name):
    case = published_case(name)
    checkpoint = case.checkpoint(pose=True, prefix="")
    network = seven_convolution_pose_network().eval()
    for group, module in network.published_modules().items():
        module.load_state_dict(checkpoint[group])
    assert sum(p.numel() for p in network.parameters()) == 1_587_776
    with torch.no_grad():
        pose = network(case.arrays["image0"], case.arrays["image1"])
    # float32 rounds the matrix's ones to 1e-7; the untrained network's rotations are hardly larger.
    torch.testing.assert_close(pose, case.arrays["pose01"], rtol=1e-4, atol=1e-7)


def test_models_are_made_for_inference_without_torchvision():
    """It takes as long to import as everything else that they need."""
    code = """
import sys
from deux_plugins.depth_models import fusionnet, kbnet, scaffnet, voiced
fusionnet.FusionNet(), kbnet.KBNet(), scaffnet.ScaffNet(), voiced.VOICED()
sys.exit("torchvision" in sys.modules)
"""
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


@pytest.mark.parametrize("dtype", [torch.float32, torch.bfloat16])
def test_the_gradient_of_a_stride_over_a_single_pixel_is_that_of_float32(dtype):
    """oneDNN leaves it unwritten in bfloat16; only the kernel's middle sees the pixel."""
    torch.manual_seed(0)
    layer = Convolution(128, 128, stride=2, activation="linear").to(dtype)
    pixel = torch.randn(4, 128, 1, 1)
    with torch.autocast("cpu", torch.bfloat16, enabled=dtype == torch.float32):
        layer(pixel.to(dtype)).float().sum().backward()
    expected = torch.zeros(128, 128, 3, 3)
    expected[:, :, 1, 1] = pixel.sum(0).flatten()
    torch.testing.assert_close(layer.conv.weight.grad.float(), expected, rtol=2e-2, atol=2e-2)


def _gradients(convolve, x, weight, upstream):
    x, weight = x.clone().requires_grad_(), weight.clone().requires_grad_()
    result = convolve(x, weight)
    return result.detach(), *torch.autograd.grad(result, (x, weight), upstream(result))


@pytest.mark.parametrize("dtype", [torch.float32, torch.bfloat16])
@pytest.mark.parametrize(
    ("size", "kernel", "stride"), [((6, 6), 3, 1), ((5, 8), 3, 2), ((6, 7), 5, 2), ((2, 3), 1, 1), ((1, 1), 3, 2)]
)
def test_small_maps_give_the_values_and_gradients_of_float64(dtype, size, kernel, stride):
    """Weights in float32 under autocast, and weights in bfloat16."""
    torch.manual_seed(0)
    x = torch.randn(3, 16, *size).to(dtype).contiguous(memory_format=torch.channels_last)
    weight = (0.1 * torch.randn(8, 16, kernel, kernel)).to(dtype)

    def upstream(result):
        return torch.randn(result.shape, generator=torch.Generator().manual_seed(1)).to(result.dtype)

    with torch.autocast("cpu", torch.bfloat16, enabled=dtype == torch.float32):
        assert is_small_map(x, weight.requires_grad_(), stride)
        outcomes = _gradients(lambda a, b: convolve_small_map(a, b, stride), x, weight.detach(), upstream)
    expected = _gradients(
        lambda a, b: functional.conv2d(a, b, stride=stride, padding=kernel // 2),
        x.double(),
        weight.detach().double(),
        upstream,
    )
    assert outcomes[0].dtype == torch.bfloat16
    assert outcomes[1].dtype == outcomes[2].dtype == dtype
    for ours, theirs in zip(outcomes, expected, strict=True):
        torch.testing.assert_close(ours.double(), theirs, rtol=2e-2, atol=2e-2 * theirs.abs().max().item())


def test_maps_are_small_where_that_pays():
    weight, x = torch.nn.Parameter(torch.zeros(8, 4, 3, 3)), torch.zeros(2, 4, 24, 24)
    assert not is_small_map(x, weight, 2)  # float32
    with torch.autocast("cpu", torch.bfloat16):
        assert is_small_map(x, weight, 2)
        assert not is_small_map(x, weight, 1)
        assert not is_small_map(x, weight.detach(), 2)
        assert is_small_map(torch.zeros(1000, 4, 1, 1), weight, 2)
        with torch.no_grad():
            assert not is_small_map(x, weight, 2)


def test_layers_compute_small_maps_alike():
    torch.manual_seed(0)
    layer = Convolution(16, 8, stride=2, batch_norm=True)
    x = torch.randn(2, 16, 6, 6)
    expected = layer(x)
    with torch.autocast("cpu", torch.bfloat16):
        torch.testing.assert_close(layer(x).float(), expected, rtol=2e-2, atol=5e-2)
