"""What the training objective relies on: depth, poses, intrinsics and colours of neighbouring frames fit together."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import pytest
import torch
from torch.nn.functional import grid_sample

from deux.contracts import Action, Frame, Robot, Scene, SceneReference
from deux.geometry.camera import Camera
from deux.simulator.mesh_simulator import MeshSimulator
from deux.simulator.starts import random_starts

CAMERA = Camera(256, 256)


class Mismatch(NamedTuple):
    """Over the target pixels that the source sees: P x 3 absolute colour error in [0, 1], P depth errors in metres."""

    color: np.ndarray
    depth: np.ndarray


def warp(source: Frame, target: Frame, intrinsics: np.ndarray) -> Mismatch:
    """Carry the target's pixels into the source by depth and poses, and compare with what is there."""
    height, width = target.depth.shape
    v, u = np.mgrid[:height, :width].reshape(2, -1)
    points = np.linalg.inv(intrinsics) @ np.stack([u, v, np.ones_like(u)]) * target.depth.ravel()
    in_world = target.pose[:3, :3] @ points + target.pose[:3, 3:]
    in_source = source.pose[:3, :3].T @ (in_world - source.pose[:3, 3:])
    depth = in_source[2]
    x, y = (intrinsics @ in_source)[:2] / np.where(depth > 0.1, depth, np.nan)
    visible = (x >= 0) & (x <= width - 1) & (y >= 0) & (y <= height - 1) & (target.depth.ravel() > 0)

    # Between pixels of a plane not depth but its inverse is linear.
    planes = np.concatenate([source.rgb.transpose(2, 0, 1) / 255.0, 1.0 / np.maximum(source.depth, 1e-3)[None]])
    grid = np.stack([2 * x / (width - 1) - 1, 2 * y / (height - 1) - 1], axis=-1)[visible]
    sampled = grid_sample(torch.tensor(planes[None]), torch.tensor(grid[None, None]), align_corners=True)[0, :, 0]
    depth_error = np.abs(1.0 / sampled[3].numpy() - depth[visible])
    unoccluded = depth_error < 0.05
    color_error = np.abs(sampled[:3].numpy().T - target.rgb.reshape(-1, 3)[visible] / 255.0)
    return Mismatch(color_error[unoccluded], depth_error[unoccluded])


@pytest.fixture(scope="module")
def pairs(flat: Scene, refer: Callable[[Scene], SceneReference]) -> list[tuple[Frame, Frame]]:
    """Neighbouring frames: a forward step, and a turn."""
    simulator = MeshSimulator(refer(flat), CAMERA, Robot())
    found = []
    for start in random_starts(simulator.free_space(), 5, np.random.default_rng(0)):
        simulator.reset(*start)
        before = simulator.observe()
        for action in (Action.FORWARD, Action.LEFT):
            simulator.step(action)
            after = simulator.observe()
            found.append((before, after))
            before = after
    return found


def test_true_depth_and_poses_warp_each_frame_onto_its_neighbour(pairs: list[tuple[Frame, Frame]]) -> None:
    visible = []
    for before, after in pairs:
        for source, target in ((before, after), (after, before)):
            mismatch = warp(source, target, CAMERA.intrinsics)
            visible.append(len(mismatch.color) / target.depth.size)
            assert mismatch.color.mean() < 0.02
            assert np.median(mismatch.depth) < 1e-5
    assert np.mean(visible) > 0.6


def test_half_a_pixel_shows(pairs: list[tuple[Frame, Frame]]) -> None:
    """With the principal point at (W / 2, H / 2) the same check fails.

    Colours hardly tell: where most pixels have little texture they differ by a few per cent more. Depths do: on
    planes the right ones agree to a millionth of a metre, so half a pixel stands out a thousandfold.
    """
    shifted = CAMERA.intrinsics
    shifted[:2, 2] += 0.5
    right = np.concatenate([warp(source, target, CAMERA.intrinsics).depth for source, target in pairs])
    wrong = np.concatenate([warp(source, target, shifted).depth for source, target in pairs])
    assert np.median(right) < 1e-6
    assert np.median(wrong) > 1e-4
    right_color = np.concatenate([warp(source, target, CAMERA.intrinsics).color for source, target in pairs])
    wrong_color = np.concatenate([warp(source, target, shifted).color for source, target in pairs])
    assert wrong_color.mean() > 1.02 * right_color.mean()
