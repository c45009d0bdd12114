"""Recordings of predictions, read back by Rerun's own reader."""

from pathlib import Path

import numpy as np
import pytest

from deux.data.frame_stream import RecordedFrame
from deux.errors import DeuxError
from deux.figures.viewer_recording import PredictionRecording, ViewerFile, check_viewer
from deux.geometry.camera import Camera
from deux.geometry.point_cloud import PointCloud
from deux.geometry.poses import camera_pose

CAMERA = Camera(12, 8)


def frame(number: int, posed: bool = True) -> RecordedFrame:
    sparse = np.zeros((8, 12), np.float32)
    sparse[3, 5] = 2.0
    image = np.full((8, 12, 3), 40 * number, np.uint8)
    pose = camera_pose(number, 1.25, -1.0, 0.3) if posed else None
    return RecordedFrame(image, sparse, CAMERA.intrinsics, None, pose)


def write(path: Path, posed: bool = True, confidence: float | None = 0.5) -> None:
    with PredictionRecording(path, "walk", (1.0, 3.0)) as recording:
        for number in range(3):
            depth = np.full((8, 12), 1.0 + number, np.float32)
            sure = None if confidence is None else np.full((8, 12), confidence, np.float32)
            cloud = PointCloud(np.full((number + 1, 3), number, np.float32), np.zeros((number + 1, 3), np.uint8))
            recording.add(number, f"frame-{number}", frame(number, posed), depth, sure, cloud)
        assert not path.exists()


def test_each_frame_has_camera_image_points_depth_cloud_and_confidence(tmp_path: Path, read_recording) -> None:
    write(tmp_path / "new" / "a.rrd")
    assert [path.name for path in (tmp_path / "new").iterdir()] == ["a.rrd"]
    found = read_recording(tmp_path / "new" / "a.rrd")
    for number in range(3):
        camera = found["/world/camera"][number]
        np.testing.assert_allclose(camera["Transform3D:translation"][0], [number, 1.25, -1.0])
        rotation = np.array(camera["Transform3D:mat3x3"][0]).reshape(3, 3).T  # column by column
        np.testing.assert_allclose(rotation, camera_pose(0, 0, 0, 0.3)[:3, :3], atol=1e-6)
        matrix = np.array(camera["Pinhole:image_from_camera"][0]).reshape(3, 3).T
        np.testing.assert_allclose(matrix, CAMERA.intrinsics)
        assert camera["Pinhole:resolution"][0] == [12.0, 8.0]
        assert found["/world/camera/image"][number]
        assert found["/world/camera/sparse"][number]["Points2D:positions"] == [[5.5, 3.5]]
        depth = np.frombuffer(bytes(found["/depth"][number]["DepthImage:buffer"][0]), np.uint16)
        assert set(depth) == {1000 * (1 + number)}
        assert found["/depth"][number]["DepthImage:meter"] == [1000.0]
        sure = np.frombuffer(bytes(found["/confidence"][number]["DepthImage:buffer"][0]), np.uint8)
        assert set(sure) == {128}
        cloud = found[f"/world/cloud/{number}"]
        assert list(cloud) == [number]  # it stays from then on
        assert cloud[number]["Points3D:positions"] == [[number] * 3] * (number + 1)
        assert found["/frame_name"][number]["TextLog:text"] == [f"frame-{number}"]


def test_without_poses_the_present_cloud_replaces_the_last(tmp_path: Path, read_recording) -> None:
    write(tmp_path / "a.rrd", posed=False, confidence=None)
    found = read_recording(tmp_path / "a.rrd")
    assert [len(found["/world/cloud/0"][number]["Points3D:positions"]) for number in range(3)] == [1, 2, 3]
    assert "/confidence" not in found
    assert found["/world/camera"][2]["Transform3D:translation"] == [[0.0, 0.0, 0.0]]


def test_an_error_leaves_no_file(tmp_path: Path, read_recording) -> None:
    def fail() -> None:
        with PredictionRecording(tmp_path / "a.rrd", "walk", (1.0, 3.0)):
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        fail()
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("earlier", [False, True])
def test_a_file_that_cannot_be_finished_is_one_sentence_and_leaves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, earlier: bool
) -> None:
    """On a full disk the writer's thread ends, and who waits for it is told so, whatever went wrong before."""

    blueprint = pytest.importorskip("rerun.blueprint")

    def fail() -> None:
        raise RuntimeError("File-writer thread shut down prematurely")

    def record() -> None:
        with ViewerFile(tmp_path / "a.rrd", "walk", blueprint.Blueprint()) as file:
            monkeypatch.setattr(file.stream, "flush", fail)
            if earlier:
                raise ZeroDivisionError

    sentence = r"a\.rrd cannot be written, the disk may be full: File-writer thread shut down prematurely\."
    with pytest.raises(ZeroDivisionError if earlier else DeuxError, match=None if earlier else sentence):
        record()
    assert list(tmp_path.iterdir()) == []


def test_a_missing_package_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("deux.figures.viewer_recording.find_spec", lambda name: None)
    with pytest.raises(DeuxError, match=r'predict\.viewer=rerun needs .* install it with pip install "deux\[viewer\]"'):
        check_viewer("predict.viewer")
