"""The warp error of true depth: on a rendered room, with every usual mistake, and on a real recording."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from void_layout import walk

from deux.doctor.true_depth_warp import FramePair, warp, warp_errors
from deux.geometry.poses import inverse

AXES = np.diag([1.0, -1.0, -1.0, 1.0])


@pytest.fixture(scope="module")
def pairs() -> list[FramePair]:
    """Neighbouring frames of a walk through a room with smooth colours."""
    frames = walk("hall", 7)
    return [
        FramePair(one.image, other.image, one.ground_truth, one.intrinsics, other.intrinsics, one.pose, other.pose)
        for one, other in zip(frames[1:], frames, strict=False)
    ]


def recorded(pairs: list[FramePair], write: Callable[[np.ndarray], np.ndarray]) -> list[FramePair]:
    """The same frames with poses as somebody else writes them."""
    return [replace(pair, pose=write(pair.pose), source_pose=write(pair.source_pose)) for pair in pairs]


def test_right_poses_and_depth_pass(pairs: list[FramePair]) -> None:
    errors = warp_errors(pairs, scale=256.0)
    assert errors.right
    assert errors.explanation is None
    assert errors.warped < 0.25 * errors.identity


def test_a_frame_warped_without_motion_is_its_neighbour(pairs: list[FramePair]) -> None:
    pair = pairs[0]
    same = warp(pair, pair.pose, pair.pose)
    np.testing.assert_allclose(same[pair.depth > 0], pair.source[pair.depth > 0], atol=0.05)
    assert np.isnan(same[pair.depth == 0]).all()


@pytest.mark.parametrize(
    ("write", "explanation"),
    [
        (inverse, "the poses are world-to-camera (error"),
        (lambda pose: pose @ AXES, "the camera's axes are OpenGL's"),
        (lambda pose: inverse(pose @ AXES), "the poses are world-to-camera with OpenGL's axes"),
    ],
)
def test_another_convention_of_poses_is_named(
    pairs: list[FramePair], write: Callable[[np.ndarray], np.ndarray], explanation: str
) -> None:
    errors = warp_errors(recorded(pairs, write))
    assert not errors.right
    assert errors.explanation is not None
    assert errors.explanation.startswith(explanation)


def test_another_unit_of_depth_is_named(pairs: list[FramePair]) -> None:
    """A room in metres x 256 that was read as millimetres is a quarter of its size."""
    small = [replace(pair, depth=pair.depth * np.float32(0.256)) for pair in pairs]
    errors = warp_errors(small, scale=1000.0)
    assert not errors.right
    assert str(errors.explanation).startswith("the depth holds 256 values per metre (metres x 256)")
    assert warp_errors(small).explanation is None  # without a scale nothing is said of units


def test_what_no_usual_mistake_explains_is_still_wrong(pairs: list[FramePair]) -> None:
    turn = np.array([[0.0, -1.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
    errors = warp_errors([replace(pair, source_pose=pair.source_pose @ turn) for pair in pairs], scale=256.0)
    assert not errors.right
    assert errors.explanation is None


def test_a_camera_that_stands_still_is_not_judged(pairs: list[FramePair]) -> None:
    still = [replace(pair, source=pair.image, source_pose=np.eye(4)) for pair in pairs]
    assert warp_errors(still).right


def test_a_real_recording(shared_data: Callable[[str], Path]) -> None:
    """Measured with an independent warp: 8.9 with the right poses, 43.9 with none and 41.0 with inverted ones."""
    folder = shared_data("rgbd") / "lounge"
    poses, matrix = np.loadtxt(folder / "poses.txt").reshape(-1, 4, 4), np.loadtxt(folder / "K.txt").reshape(3, 3)
    images = [cv2.imread(str(file))[..., ::-1].copy() for file in sorted((folder / "images").iterdir())]
    depths = [cv2.imread(str(file), cv2.IMREAD_UNCHANGED) / 1000.0 for file in sorted((folder / "depth").iterdir())]
    pairs = [
        FramePair(images[i], images[i + 1], depths[i], matrix, matrix, poses[i], poses[i + 1])
        for i in range(0, len(poses) - 1, 5)
    ]
    errors = warp_errors(pairs, scale=1000.0)
    assert errors.warped == pytest.approx(8.9, abs=2.5)
    assert errors.identity == pytest.approx(43.9, abs=8.0)
    assert errors.warped <= 0.25 * errors.identity
    wrong = warp_errors(recorded(pairs, inverse), scale=1000.0)
    assert wrong.warped > 0.75 * errors.identity
    assert str(wrong.explanation).startswith("the poses are world-to-camera")
