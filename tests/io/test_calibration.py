"""Camera matrices in text files."""

import re
from pathlib import Path

import numpy as np
import pytest

from deux.errors import DeuxError
from deux.geometry.camera import Camera
from deux.geometry.poses import camera_pose
from deux.io.calibration import camera_warning, read_intrinsics, read_pose, write_matrix


def test_every_bit_of_a_pose_comes_back(tmp_path: Path) -> None:
    pose = camera_pose(1 / 3, 1.25, -np.pi, 0.1234567)
    write_matrix(tmp_path / "p.txt", pose)
    np.testing.assert_array_equal(read_pose(tmp_path / "p.txt"), pose)
    np.testing.assert_array_equal(np.loadtxt(tmp_path / "p.txt"), pose)


def test_a_pose_of_three_rows_is_read(tmp_path: Path) -> None:
    pose = camera_pose(1.0, 2.0, 3.0, 0.5)
    np.savetxt(tmp_path / "p.txt", pose[:3])
    np.testing.assert_array_equal(read_pose(tmp_path / "p.txt"), pose)


@pytest.mark.parametrize("text", ["", "1 2 3", "nan " * 16, "one two", "2 0 0 0  0 1 0 0  0 0 1 0"])
def test_what_is_no_pose_is_refused_by_name(tmp_path: Path, text: str) -> None:
    (tmp_path / "p.txt").write_text(text)
    with pytest.raises(DeuxError, match=r"p\.txt"):
        read_pose(tmp_path / "p.txt")


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (lambda pose: pose @ np.diag([-1.0, 1, 1, 1]), "a reflection, with a determinant of -1"),
        (lambda pose: pose.T, "its fourth row is not 0 0 0 1, so it may be transposed"),
        (lambda pose: pose + 1e9 * np.eye(4, k=3), "has a position of 1e\\+09 m"),
    ],
)
def test_poses_that_would_be_silently_wrong_are_refused(tmp_path: Path, change, sentence: str) -> None:
    np.savetxt(tmp_path / "p.txt", change(camera_pose(1.0, 2.0, 3.0, 0.5)))
    with pytest.raises(DeuxError, match=rf"p\.txt .*{sentence}"):
        read_pose(tmp_path / "p.txt")


@pytest.mark.parametrize("focus", ["1e-30", "1e30"])
def test_focal_lengths_of_no_camera_are_refused(tmp_path: Path, focus: str) -> None:
    (tmp_path / "K.txt").write_text(f"{focus} 0 20 0 30 20 0 0 1")
    with pytest.raises(DeuxError, match=r"K\.txt has the focal lengths 1e[+-]30 and 30: they must be in pixels"):
        read_intrinsics(tmp_path / "K.txt")


def test_intrinsics_round_trip(tmp_path: Path) -> None:
    write_matrix(tmp_path / "K.txt", Camera(hfov=77.0).intrinsics)
    np.testing.assert_array_equal(read_intrinsics(tmp_path / "K.txt"), Camera(hfov=77.0).intrinsics)


@pytest.mark.parametrize(
    "text",
    [
        "0 0 0 0 0 0 0 0 0",
        "0 0 20 0 30 20 0 0 1",
        "30 0 20 0 -30 20 0 0 1",
        "30 0 20 0 30 20 0 0 0",
        "30 0 20 1 30 20 0 0 1",
        "inf 0 20 0 30 20 0 0 1",
        "30 0 20",
    ],
)
def test_singular_and_other_wrong_intrinsics_are_refused_by_name(tmp_path: Path, text: str) -> None:
    (tmp_path / "K.txt").write_text(text)
    with pytest.raises(DeuxError, match=r"K\.txt is not "):
        read_intrinsics(tmp_path / "K.txt")


K = Camera(640, 480, hfov=60.0).intrinsics


@pytest.mark.parametrize("hfov", [20.0, 60.0, 120.0, 160.0])
def test_cameras_of_all_views_are_let_through(hfov: float) -> None:
    assert camera_warning(Camera(640, 480, hfov=hfov).intrinsics, 480, 640, "K.txt") is None


@pytest.mark.parametrize(
    ("matrix", "sentence"),
    [
        (np.diag([1 / 640, 1 / 480, 1.0]) @ K, "multiply its first row by the width 640 and its second row by the hei"),
        (np.diag([4.0, 4.0, 1.0]) @ K, r"\(1278, 958\) is outside of the image of 640 x 480 pixels: K\.txt seems to"),
        (np.diag([0.5, 0.5, 1.0]) @ K, r"far from the centre .*: K\.txt seems to belong to images of about 320 x 240"),
        (np.diag([1.6, 1.6, 1.0]) @ K, r"far from the centre .*: K\.txt seems to belong to images of about 1023 x 767"),
        (np.diag([0.05, 0.05, 1.0]) @ K, r"far from the centre .*: K\.txt seems to belong to images of about 33 x 25"),
        (K - np.diag([K[0, 0] - 4.0, K[1, 1] - 4.0, 0.0]), r"4 and 4 are too short .* in pixels, not in millimetres"),
    ],
    ids=["normalised", "four times", "half", "larger", "a twentieth", "millimetres"],
)
def test_a_matrix_of_another_image_is_noticed(matrix: np.ndarray, sentence: str) -> None:
    found = camera_warning(matrix, 480, 640, "K.txt")
    assert found is not None
    assert re.search(sentence, found)
    assert "\n" not in found


def test_matrices_may_be_separated_by_commas(tmp_path: Path) -> None:
    np.savetxt(tmp_path / "K.txt", Camera(hfov=77.0).intrinsics, fmt="%.18e", delimiter=",")
    np.testing.assert_array_equal(read_intrinsics(tmp_path / "K.txt"), Camera(hfov=77.0).intrinsics)
    np.savetxt(tmp_path / "pose.txt", np.eye(4), delimiter=", ")
    np.testing.assert_array_equal(read_pose(tmp_path / "pose.txt"), np.eye(4))
