from pathlib import Path

import cv2
import numpy as np
import pytest
import torch

from deux.geometry import reprojection
from deux.geometry.camera import Camera
from deux.geometry.poses import camera_pose, source_from_target
from deux.geometry.reprojection import reproject

CAMERA = Camera(width=64, height=48, hfov=80.0)
K = torch.tensor(CAMERA.intrinsics, dtype=torch.float32)[None]


@pytest.fixture(params=["as chosen", "kornia"])
def path(request, monkeypatch):
    """The projection of the device at hand, and kornia's, which is that of other devices."""
    if request.param == "kornia":
        monkeypatch.setattr(reprojection, "_project", reprojection._project_by_kornia)


on_both_paths = pytest.mark.usefixtures("path")


def noise(*shape: int, seed: int = 0) -> torch.Tensor:
    return torch.rand(*shape, generator=torch.Generator().manual_seed(seed))


def poses(*translations: tuple[float, float, float]) -> torch.Tensor:
    result = torch.eye(4).repeat(1, len(translations), 1, 1)
    result[0, :, :3, 3] = torch.tensor(translations)
    return result


def wall(pose: np.ndarray) -> tuple[torch.Tensor, torch.Tensor]:
    """Image and depth of a smoothly coloured slanted wall, by intersecting every ray with its plane."""
    normal, offset = np.array([0.3, 0.2, 1.0]), -3.0
    directions = CAMERA.rays() @ pose[:3, :3].T
    depth = (offset - normal @ pose[:3, 3]) / (directions @ normal)
    points = pose[:3, 3] + directions * depth[..., None]
    image = np.stack([0.5 + 0.4 * np.sin(points @ w) for w in ([1.0, 0.5, 0.0], [0.0, 1.2, 0.7], [0.8, -0.9, 0.3])])
    return torch.tensor(image, dtype=torch.float32), torch.tensor(depth, dtype=torch.float32)


@on_both_paths
def test_identity_gives_the_image_back():
    images = noise(1, 1, 3, 48, 64)
    rebuilt, visible = reproject(images, noise(1, 1, 48, 64) + 0.5, K, poses((0, 0, 0)))
    torch.testing.assert_close(rebuilt, images, atol=1e-4, rtol=0)
    assert visible.all()


@on_both_paths
def test_sideways_motion_shifts_a_frontal_wall_by_whole_pixels():
    images = noise(1, 2, 3, 48, 64)
    step = 2.0 / CAMERA.focal_length  # one pixel at two metres
    rebuilt, visible = reproject(images, torch.full((1, 1, 48, 64), 2.0), K, poses((3 * step, 0, 0), (0, -2 * step, 0)))
    torch.testing.assert_close(rebuilt[0, 0, :, :, :-3], images[0, 0, :, :, 3:], atol=1e-4, rtol=0)
    torch.testing.assert_close(rebuilt[0, 1, :, 2:], images[0, 1, :, :-2], atol=1e-4, rtol=0)
    assert visible[0, 0, 0, :, :-3].all()
    assert not visible[0, 0, 0, :, -3:].any()
    assert visible[0, 1, 0, 2:].all()
    assert not visible[0, 1, 0, :2].any()


@on_both_paths
def test_slanted_wall_seen_from_two_poses():
    target_pose = camera_pose(0.1, 1.2, 0.3, yaw=0.05)
    source_pose = camera_pose(0.3, 1.25, 0.1, yaw=-0.15)
    target, depth = wall(target_pose)
    source, _ = wall(source_pose)
    motion = torch.tensor(source_from_target(target_pose, source_pose), dtype=torch.float32)
    rebuilt, visible = reproject(source[None, None], depth[None, None], K, motion[None, None])
    error = (rebuilt[0, 0] - target).abs()[:, visible[0, 0, 0]]
    assert visible.float().mean() > 0.6
    assert error.max() < 5e-3  # bilinear sampling of the texture
    wrong, _ = reproject(source[None, None], depth[None, None], K, motion.inverse()[None, None])
    assert (wrong[0, 0] - target).abs().mean() > 0.05


@on_both_paths
def test_points_behind_the_camera_are_invisible_and_give_finite_gradients():
    depth = torch.full((1, 1, 48, 64), 2.0, requires_grad=True)
    rebuilt, visible = reproject(noise(1, 2, 3, 48, 64), depth, K, poses((0, 0, -2.0), (0, 0, -5.0)))
    rebuilt.square().sum().backward()
    assert not visible.any()
    assert torch.isfinite(rebuilt).all()
    assert torch.isfinite(depth.grad).all()


@on_both_paths
@pytest.mark.parametrize("padding", ["border", "zeros"])
@pytest.mark.parametrize("value", [float("nan"), float("inf"), 1e30])
def test_broken_depth_is_invisible_and_harms_no_other_pixel(value, padding):
    """A NaN in the sampled positions makes PyTorch's own backward pass write out of bounds."""
    depth = torch.full((1, 1, 48, 64), 2.0)
    depth[..., 7, 9] = value
    depth.requires_grad_()
    rebuilt, visible = reproject(noise(1, 1, 3, 48, 64), depth, K, poses((0.1, 0, 0.1)), padding)
    rebuilt.sum().backward()
    sound = torch.ones(48, 64, dtype=torch.bool)
    sound[7, 9] = False
    assert torch.isfinite(rebuilt).all()
    assert torch.isfinite(depth.grad[0, 0][sound]).all()
    assert value == 1e30 or not visible[..., 7, 9].any()


@on_both_paths
def test_pixels_without_depth_are_invisible():
    depth = torch.full((1, 1, 48, 64), 2.0)
    depth[..., 10:20, 5:9] = 0.0
    _, visible = reproject(noise(1, 1, 3, 48, 64), depth, K, poses((0, 0, 0)))
    assert torch.equal(visible[0, 0], depth[0] > 0)


@on_both_paths
def test_padding():
    images, depth = noise(1, 1, 3, 48, 64) + 0.1, torch.full((1, 1, 48, 64), 2.0)
    motion = poses((20 * 2.0 / CAMERA.focal_length, 0, 0))
    border, visible = reproject(images, depth, K, motion)
    zeros, visible_zeros = reproject(images, depth, K, motion, padding="zeros")
    outside = ~visible.expand_as(border)
    assert torch.equal(visible, visible_zeros)
    torch.testing.assert_close(border[..., -10], images[..., -1], atol=1e-4, rtol=0)
    assert (zeros[..., -10] == 0).all()
    torch.testing.assert_close(border[~outside], zeros[~outside], atol=1e-4, rtol=0)


@on_both_paths
def test_mixed_precision_does_not_reach_the_geometry():
    images, depth, motion = noise(1, 1, 3, 48, 64), noise(1, 1, 48, 64) + 1.0, poses((0.1, 0.0, 0.05))
    expected, _ = reproject(images, depth, K, motion)
    with torch.autocast("cpu", torch.bfloat16):
        rebuilt, _ = reproject(images, depth, K, motion)
    assert torch.equal(rebuilt, expected)


@on_both_paths
@pytest.mark.parametrize("dtype", [torch.bfloat16, torch.float16])
def test_half_precision_inputs_give_float32(dtype):
    images, depth = noise(1, 1, 3, 48, 64).to(dtype), (noise(1, 1, 48, 64) + 1.0).to(dtype)
    rebuilt, _ = reproject(images, depth, K, poses((0, 0, 0)))
    assert rebuilt.dtype == torch.float32
    torch.testing.assert_close(rebuilt, images.float(), atol=1e-4, rtol=0)


@on_both_paths
def test_gradients_in_depth_and_pose():
    images = noise(1, 2, 3, 6, 7).double()
    depth = (noise(1, 1, 6, 7, seed=1) + 1.0).double().requires_grad_()
    intrinsics = torch.tensor([[[5.0, 0.0, 2.8], [0.0, 6.0, 2.6], [0.0, 0.0, 1.0]]], dtype=torch.float64)
    motion = poses((0.11, 0.02, 0.07), (-0.08, 0.05, -0.03)).double().requires_grad_()
    assert torch.autograd.gradcheck(lambda d, p: reproject(images, d, intrinsics, p)[0], (depth, motion), eps=1e-7)


@on_both_paths
def test_agrees_with_the_published_reconstructions(shared_data):
    case = {key: torch.from_numpy(value) for key, value in np.load(shared_data("cases") / "kbnet.npz").items()}
    sources = torch.stack([case["image1"], case["image2"]], dim=1)
    motion = torch.stack([case["pose01"], case["pose02"]], dim=1)
    rebuilt, _ = reproject(sources, case["output_depth"], case["intrinsics"], motion)
    expected = torch.stack([case["image01"], case["image02"]], dim=1)
    torch.testing.assert_close(rebuilt, expected, atol=1e-4, rtol=0)


@pytest.mark.parametrize(("height", "width"), [(48, 64), (33, 47), (1, 9), (7, 1)])
def test_both_projections_agree_in_values_and_gradients(height, width):
    """A camera with skew, turned source cameras, points in front and behind; the outcome's weights are random."""
    generator = torch.Generator().manual_seed(0)
    depth = torch.rand(2, 1, height, width, generator=generator, dtype=torch.float64) * 4.0
    k = torch.tensor([[40.0, 1.5, 20.3], [0.0, 45.0, 17.1], [0.0, 0.0, 1.0]], dtype=torch.float64).repeat(2, 1, 1)
    motion = torch.eye(4, dtype=torch.float64).repeat(2, 3, 1, 1)
    motion[..., :3, :] += 0.2 * torch.randn(2, 3, 3, 4, generator=generator, dtype=torch.float64)
    motion[:, 2, 2, 3] -= 2.0
    weights = torch.rand(2, 3, 3, height, width, generator=generator, dtype=torch.float64)
    outcomes = []
    for project in (reprojection._project_by_broadcasts, reprojection._project_by_kornia):
        inputs = [x.clone().requires_grad_() for x in (depth, motion)]
        positions, distance = project(inputs[0], k, inputs[1])
        in_front = distance > reprojection.NEAREST
        assert 0.1 < in_front.double().mean() < 0.95
        values = torch.cat([positions * in_front, distance], dim=2)
        in_depth, in_motion = torch.autograd.grad((values.clamp(-50, 50) * weights).sum(), inputs)
        outcomes.append([values, in_depth, in_motion[..., :3, :]])
    for ours, kornias in zip(*outcomes, strict=True):
        torch.testing.assert_close(ours, kornias, atol=1e-9, rtol=1e-9)


def test_both_projections_agree_in_float32(monkeypatch):
    images, depth, motion = noise(1, 2, 3, 48, 64), noise(1, 1, 48, 64) + 1.0, poses((0.1, 0, 0.05), (-0.1, 0.1, -0.2))
    outcomes = []
    for project in (reprojection._project_by_broadcasts, reprojection._project_by_kornia):
        monkeypatch.setattr(reprojection, "_project", project)
        outcomes.append(reproject(images, depth, K, motion))
    torch.testing.assert_close(outcomes[0][0], outcomes[1][0], atol=1e-5, rtol=0)
    assert torch.equal(outcomes[0][1], outcomes[1][1])


@on_both_paths
def test_agrees_with_the_projection_equation_where_the_camera_has_skew():
    """An image that is linear in its pixels shows where it was sampled."""
    k = torch.tensor([[50.0, 4.0, 30.0], [0.0, 60.0, 20.0], [0.0, 0.0, 1.0]], dtype=torch.float64)
    v, u = torch.meshgrid(torch.arange(48.0), torch.arange(64.0), indexing="ij")
    motion = poses((0.05, -0.04, 0.1)).double()
    depth = (noise(1, 1, 48, 64) + 2.0).double()
    rebuilt, visible = reproject(torch.stack([u, v, u + v])[None, None].double(), depth, k[None], motion)
    pixels = torch.stack([u, v, torch.ones_like(u)]).double().flatten(1)
    projected = k @ (torch.linalg.inv(k) @ pixels * depth.flatten() + motion[0, 0, :3, 3:])
    expected = (projected[:2] / projected[2]).view(2, 48, 64)
    assert visible.float().mean() > 0.8
    torch.testing.assert_close(rebuilt[0, 0, :2][:, visible[0, 0, 0]], expected[:, visible[0, 0, 0]])


def test_no_value_is_read_back_from_the_device():
    """Tensors without data: whatever asks for a value, for which the CPU would wait on a GPU, fails."""
    inputs = [x.to("meta") for x in (noise(2, 1, 8, 9), K.repeat(2, 1, 1), torch.eye(4).repeat(2, 3, 1, 1))]
    positions, distance = reprojection._project(*inputs)
    assert positions.shape == (2, 3, 2, 8, 9)
    assert distance.shape == (2, 3, 1, 8, 9)


@pytest.mark.gpu
@pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a GPU")
def test_a_gpu_gives_the_values_of_the_cpu_and_is_not_waited_for():
    inputs = noise(1, 2, 3, 48, 64), noise(1, 1, 48, 64) + 1.0, K, poses((0.1, 0, 0.05), (-0.1, 0.1, -0.2))
    expected, expected_visible = reproject(*inputs)
    on_card = [x.cuda() for x in inputs]
    reproject(*on_card)  # what is made once
    mode = torch.cuda.get_sync_debug_mode()
    torch.cuda.set_sync_debug_mode("error")
    try:
        rebuilt, visible = reproject(*on_card)
    finally:
        torch.cuda.set_sync_debug_mode(mode)
    torch.testing.assert_close(rebuilt.cpu(), expected, atol=1e-4, rtol=0)
    assert torch.equal(visible.cpu(), expected_visible)


def recorded_pair(folder: Path, i: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Target image, its depth in metres, source image and relative pose of frames i and i + 1 of a recording."""
    names = [path.name for path in sorted((folder / "images").iterdir())]
    target, source = (cv2.imread(str(folder / "images" / name)).astype(np.float32) for name in names[i : i + 2])
    depth = cv2.imread(str(folder / "depth" / names[i]), cv2.IMREAD_UNCHANGED).astype(np.float32) / 1000.0
    camera_poses = np.loadtxt(folder / "poses.txt").reshape(-1, 4, 4)
    return target, depth, source, source_from_target(camera_poses[i], camera_poses[i + 1])


def warped_by_opencv(source: np.ndarray, depth: np.ndarray, k: np.ndarray, motion: np.ndarray) -> np.ndarray:
    v, u = np.mgrid[: depth.shape[0], : depth.shape[1]]
    points = np.stack([(u - k[0, 2]) / k[0, 0] * depth, (v - k[1, 2]) / k[1, 1] * depth, depth], axis=-1)
    pixels = (points @ motion[:3, :3].T + motion[:3, 3]) @ k.T
    x, y = (pixels[..., axis] / pixels[..., 2] for axis in (0, 1))
    return cv2.remap(source, x.astype(np.float32), y.astype(np.float32), cv2.INTER_LINEAR)


@on_both_paths
def test_recorded_frames_match_with_their_recorded_poses(shared_data):
    folder = shared_data("rgbd") / "lounge"
    k = np.loadtxt(folder / "K.txt")
    errors = []
    for i in range(0, 56, 5):
        target, depth, source, motion = recorded_pair(folder, i)
        sources = torch.from_numpy(source).permute(2, 0, 1)[None, None].repeat(1, 2, 1, 1, 1)
        both = torch.tensor(np.stack([motion, np.eye(4)]), dtype=torch.float32)[None]
        k_tensor = torch.tensor(k, dtype=torch.float32)[None]
        rebuilt, visible = reproject(sources, torch.from_numpy(depth)[None, None], k_tensor, both)
        rebuilt, seen = rebuilt[0].permute(0, 2, 3, 1).numpy(), visible[0, :, 0].numpy()
        expected = warped_by_opencv(source, depth, k, motion)
        # OpenCV rounds the sampled position to 1/32 pixel.
        assert np.abs(rebuilt[0] - expected)[seen[0]].mean() < 0.5
        errors.append([np.abs(rebuilt[s] - target)[seen[s]].mean() for s in (0, 1)])
    moved, still = np.mean(errors, axis=0)
    assert moved < 9.0
    assert still > 4.0 * moved
