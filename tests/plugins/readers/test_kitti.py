"""The layout of KITTI depth completion, beside the raw recordings."""

import logging
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from written_frames import save_depth, save_image, video, with_sources

from deux.contracts import FrameReference, MissingSplit
from deux.errors import DeuxError
from deux.registry import registry
from deux.testing.readers import ReaderSuite, RecordedFrame, Recordings
from deux_plugins.readers.kitti import Kitti

DATE = "2011_09_26"
CLOCK = "calib_time: 09-Jan-2012 13:57:47\n"


def calibration(folder: Path, left: np.ndarray, right: np.ndarray | None = None) -> None:
    """A date's calib_cam_to_cam.txt: each camera's size, distortion and projection matrix."""
    lines = ""
    for camera, matrix in (("02", left), ("03", left if right is None else right)):
        projection = np.concatenate([matrix, [[45.0], [-0.3], [0.005]]], axis=1).ravel()
        lines += f"S_{camera}: 1.392e+03 5.12e+02\nK_{camera}: 9.5e+02 0 6.9e+02 0 9.4e+02 2.4e+02 0 0 1\n"
        lines += f"P_rect_{camera}: {' '.join(f'{value:.18e}' for value in projection)}\n"
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "calib_cam_to_cam.txt").write_text(CLOCK + lines)


def drive_name(number: int, date: str = DATE) -> str:
    return f"{date}_drive_{number:04d}_sync"


def write_drive(
    folder: Path,
    drive: str,
    frames: list[RecordedFrame],
    split: str = "train",
    cameras: tuple[int, ...] = (2,),
    ends: int = 0,
    raw: str = "kitti_raw",
    suffix: str = ".png",
) -> None:
    """Images and depth maps; the `ends` outermost frames have no depth, as in the benchmark."""
    for camera in cameras:
        name = f"image_{camera:02d}"
        for number, frame in enumerate(frames):
            save_image(folder / raw / drive[:10] / drive / name / "data" / f"{number:010d}{suffix}", frame.image)
            if ends <= number < len(frames) - ends:
                for kind, root, depth in (
                    ("groundtruth", "data_depth_annotated", frame.ground_truth),
                    ("velodyne_raw", "data_depth_velodyne", frame.sparse_depth),
                ):
                    save_depth(folder / root / split / drive / "proj_depth" / kind / name / f"{number:010d}.png", depth)


def write_oxts(folder: Path, drive: str, speeds: list[float]) -> None:
    for number, speed in enumerate(speeds):
        path = folder / "kitti_raw" / drive[:10] / drive / "oxts" / "data" / f"{number:010d}.txt"
        path.parent.mkdir(parents=True, exist_ok=True)
        values = np.arange(30.0)
        values[8], values[9] = 0.6 * speed, 0.8 * speed
        path.write_text(" ".join(f"{value:.12g}" for value in values) + "\n")


def write_selection(folder: Path, frames: list[RecordedFrame], drive: str, truth: bool = True) -> None:
    for number, frame in enumerate(frames):
        kinds = {"image": frame.image, "velodyne_raw": frame.sparse_depth, "groundtruth_depth": frame.ground_truth}
        for kind in kinds if truth else ("image", "velodyne_raw"):
            said = {"groundtruth_depth": "groundtruth_depth"}.get(kind, kind)
            name = f"{drive}_{said}_{number:010d}_image_02" if truth else f"{number:010d}"
            (save_image if kind == "image" else save_depth)(folder / kind / f"{name}.png", kinds[kind])
        name = f"{drive}_image_{number:010d}_image_02" if truth else f"{number:010d}"
        (folder / "intrinsics").mkdir(exist_ok=True)
        (folder / "intrinsics" / f"{name}.txt").write_text(" ".join(map(repr, frame.intrinsics.ravel().tolist())))


class TestKitti(ReaderSuite):
    """A sequence is a camera of a drive, and each has a date, so a calibration, of its own."""

    has_poses = False

    def write_dataset(self, folder: Path, recordings: Recordings) -> None:
        for number, name in enumerate(sorted(recordings)):
            date = f"2011_09_{26 + number}"
            write_drive(folder, drive_name(1, date), list(recordings[name]))
            calibration(folder / "kitti_raw" / date, recordings[name][0].intrinsics)

    def make_reader(self, folder: Path) -> Kitti:
        return Kitti(folder)


def test_source_frames_without_depth_are_images_of_the_raw_recording(tmp_path: Path) -> None:
    write_drive(tmp_path, drive_name(1), list(video(9)), cameras=(2, 3), ends=2)
    calibration(tmp_path / "kitti_raw" / DATE, np.eye(3), np.diag([2.0, 2.0, 1.0]))
    found = with_sources(Kitti(tmp_path), (-1, 1))
    assert [target for target, _ in found] == [
        FrameReference(f"{drive_name(1)}_image_{camera}", f"{number:010d}")
        for camera in ("02", "03")
        for number in range(2, 7)
    ]
    assert [source.name for source in found[0].sources] == ["0000000001", "0000000003"]
    assert Kitti(tmp_path).intrinsics(found[-1].target)[0, 0] == 2.0
    assert len(with_sources(Kitti(tmp_path, cameras=(3,)), (-1, 1))) == 5


def test_jpeg_images_in_a_folder_elsewhere(tmp_path: Path) -> None:
    frames = list(video(4))
    write_drive(tmp_path, drive_name(1), frames, raw="../elsewhere", suffix=".jpg")
    reader = Kitti(tmp_path, raw=tmp_path.parent / "elsewhere")
    found = with_sources(reader, (-1,))
    assert len(found) == 3
    decoded = cv2.imread(str(tmp_path.parent / f"elsewhere/{DATE}/{drive_name(1)}/image_02/data/0000000001.jpg"))
    np.testing.assert_allclose(reader.image(found[0].target)[..., ::-1].astype(int), decoded, atol=3)


def test_frames_in_which_the_car_stands_are_no_training_targets(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    write_drive(tmp_path, drive_name(1), list(video(6)))
    calibration(tmp_path / "kitti_raw" / DATE, np.eye(3))
    write_oxts(tmp_path, drive_name(1), [9.0, 1.0, 0.2, 0.4, 0.6, 9.0])
    with caplog.at_level(logging.WARNING):
        moving = with_sources(Kitti(tmp_path), (-1,))
    assert [target.name[-1] for target, _ in moving] == ["1", "4", "5"]
    assert moving[1].sources[0].name[-1] == "3"
    assert f"{tmp_path}, train: 4 of 6 frames: 2 static" in [record.getMessage() for record in caplog.records]
    assert len(with_sources(Kitti(tmp_path, min_speed=0.0), (-1,))) == 5
    with pytest.raises(MissingSplit, match=r"the car is slower than data\.min_speed=99 m/s in all 6 frames\.$"):
        Kitti(tmp_path, min_speed=99.0).triplets("train", (-1,))


def test_the_published_list_of_static_frames(tmp_path: Path) -> None:
    write_drive(tmp_path, drive_name(1), list(video(4)), cameras=(2, 3))
    calibration(tmp_path / "kitti_raw" / DATE, np.eye(3))
    write_oxts(tmp_path, drive_name(1), [0.0] * 4)
    listed = tmp_path / "static_frames.txt"
    listed.write_text(f"{DATE} {drive_name(1)} 0000000002\n{DATE} {drive_name(7)} 0000000001\n")
    found = with_sources(Kitti(tmp_path, static_frames=listed), (-1,))
    assert [target.name[-1] for target, _ in found] == ["1", "3"] * 2
    listed.write_text("0000000002\n")
    with pytest.raises(DeuxError, match=r"static_frames\.txt has the line '0000000002': date, drive and frame"):
        with_sources(Kitti(tmp_path, static_frames=listed), (-1,))


def test_validation_is_the_official_one_or_training_drives(tmp_path: Path) -> None:
    for number, split in ((1, "train"), (2, "val"), (9, "train"), (10, "train")):
        write_drive(tmp_path, drive_name(number), list(video(3)), split)
    calibration(tmp_path / "kitti_raw" / DATE, np.eye(3))

    def drives(reader: Kitti, split: str) -> set[str]:
        return {target.sequence[17:21] for target, _ in reader.triplets(split, (-1,))}

    assert drives(Kitti(tmp_path), "train") == {"0001", "0009", "0010"}
    assert drives(Kitti(tmp_path), "validation") == {"0002"}
    assert len(Kitti(tmp_path).triplets("validation", (-1,))) == 3
    assert drives(Kitti(tmp_path, validation=1), "train") == {"0001", "0009"}
    assert drives(Kitti(tmp_path, validation=1), "validation") == {"0010"}


def test_the_selection_is_a_test_split_of_single_frames(tmp_path: Path) -> None:
    frames = [
        replace(frame, intrinsics=frame.intrinsics * [[1.0 + n], [1.0], [1.0]]) for n, frame in enumerate(video(3))
    ]
    write_selection(tmp_path / "depth_selection/val_selection_cropped", frames, drive_name(2))
    reader = Kitti(tmp_path)
    found = reader.triplets("test", (-1, 1))
    assert [sources for _, sources in found] == [()] * 3
    for (target, _), frame in zip(found, frames, strict=True):
        np.testing.assert_array_equal(reader.image(target), frame.image)
        np.testing.assert_array_equal(reader.sparse_depth(target), frame.sparse_depth)
        np.testing.assert_array_equal(reader.ground_truth(target), frame.ground_truth)
        np.testing.assert_array_equal(reader.intrinsics(target), frame.intrinsics)
    with pytest.raises(DeuxError, match=r"no train frames.*data_depth_velodyne/train"):
        with_sources(reader, (-1, 1))


def test_a_drive_is_one_place_whichever_camera_sees_it(tmp_path: Path) -> None:
    for number in (1, 3):
        write_drive(tmp_path, drive_name(number), list(video(3)), cameras=(2, 3))
    for number in (2, 4):
        frames = list(video(2))
        write_selection(tmp_path / "depth_selection/val_selection_cropped", frames, drive_name(number))
    reader = Kitti(tmp_path)
    listed = [*reader.triplets("train", (-1,)), *reader.triplets("test", ())]
    places = {target: reader.place(target) for target, _ in listed}
    assert len({frame.sequence for frame in places}) == 5
    assert set(places.values()) == {drive_name(number) for number in (1, 2, 3, 4)}
    anonymous = Kitti(tmp_path, test="test_depth_completion_anonymous")
    assert anonymous.place(FrameReference(anonymous.test, "0000000000")) == anonymous.test


def test_the_anonymous_test_set_has_no_ground_truth(tmp_path: Path) -> None:
    frames = list(video(2))
    write_selection(tmp_path / "test_depth_completion_anonymous", frames, "", truth=False)
    reader = Kitti(tmp_path, test="test_depth_completion_anonymous")
    found = reader.triplets("test", ())
    assert len(found) == 2
    assert reader.ground_truth(found[1].target) is None
    np.testing.assert_array_equal(reader.sparse_depth(found[1].target), frames[1].sparse_depth)
    np.testing.assert_array_equal(reader.intrinsics(found[1].target), frames[1].intrinsics)


def test_what_is_missing_is_named(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    with pytest.raises(DeuxError, match=r"has no depth maps of KITTI: data_depth_velodyne/train"):
        Kitti(tmp_path)
    write_drive(tmp_path, drive_name(1), list(video(4)), raw="elsewhere")
    with pytest.raises(DeuxError, match=r"has no images of its drives.*data\.raw="):
        with_sources(Kitti(tmp_path), (-1,))
    reader = Kitti(tmp_path, raw=tmp_path / "elsewhere")
    with pytest.raises(DeuxError, match=r"calib_cam_to_cam\.txt is missing"):
        reader.intrinsics(with_sources(reader, (-1,))[0].target)
    (tmp_path / "elsewhere" / DATE / "calib_cam_to_cam.txt").write_text(CLOCK)
    with pytest.raises(DeuxError, match=r"has no line P_rect_02: with twelve numbers"):
        reader.intrinsics(with_sources(reader, (-1,))[0].target)
    (tmp_path / "elsewhere" / DATE / drive_name(1) / "image_02/data/0000000003.png").unlink()
    with caplog.at_level(logging.WARNING):
        assert len(with_sources(Kitti(tmp_path, raw=tmp_path / "elsewhere"), (-1,))) == 2
    assert f"{tmp_path}: 3 of 4 frames: 1 without raw image" in [record.getMessage() for record in caplog.records]
    with pytest.raises(DeuxError, match=r"data\.cameras is \[0\]"):
        Kitti(tmp_path, cameras=(0,))


def test_is_installed(tmp_path: Path) -> None:
    write_drive(tmp_path, drive_name(1), list(video(2)))
    assert registry().create("readers", "kitti", {"cameras": [2]}, tmp_path) == Kitti(tmp_path, cameras=(2,))
