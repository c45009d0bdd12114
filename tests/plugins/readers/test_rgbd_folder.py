"""Plain folders of images and depth maps, written by hand and the real one beside the project."""

import logging
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image
from written_frames import (
    DENSITY,
    SampledSuite,
    in_multiples_of,
    save_depth,
    save_image,
    save_matrix,
    video,
    with_sources,
)

from deux.contracts import FrameReference, MissingSplit
from deux.errors import DeuxError
from deux.geometry.poses import source_from_target
from deux.geometry.reprojection import reproject
from deux.registry import registry
from deux.testing.readers import ReaderSuite, RecordedFrame, Recordings, record
from deux_plugins.readers.rgbd_folder import RgbdFolder


def write_video(folder: Path, frames: list[RecordedFrame], poses: bool = True, name: str = "frame_{}") -> Path:
    """Frames called frame_0, frame_1 and so on, depth in millimetres, one line for each pose."""
    save_matrix(folder / "K.txt", frames[0].intrinsics)
    for number, frame in enumerate(frames):
        save_image(folder / "rgb" / f"{name.format(number)}.png", frame.image)
        save_depth(folder / "depth" / f"{name.format(number)}.png", frame.ground_truth, 1000.0)
    if poses:
        np.savetxt(folder / "poses.txt", [frame.pose.ravel() for frame in frames], fmt="%.18e")
    return folder


class TestVideos(SampledSuite):
    """A subfolder for each video, points sampled from the depth."""

    has_poses = True

    @pytest.fixture
    def recordings(self) -> Recordings:
        return in_multiples_of(1000.0, record())

    def write_dataset(self, folder: Path, recordings: Recordings) -> None:
        for name, frames in recordings.items():
            write_video(folder / name, list(frames))

    def make_reader(self, folder: Path) -> RgbdFolder:
        return RgbdFolder(folder, validation=0, test=0, density=DENSITY)


class TestVideosWithPointsOfTheirOwn(ReaderSuite):
    """Points from the folder sparse/, metres x 256, and no poses."""

    has_poses = False

    def write_dataset(self, folder: Path, recordings: Recordings) -> None:
        for name, frames in recordings.items():
            save_matrix(folder / name / "intrinsics.txt", frames[0].intrinsics)
            for number, frame in enumerate(frames):
                save_image(folder / name / "images" / f"{number}.png", frame.image)
                save_depth(folder / name / "depth" / f"{number}.png", frame.ground_truth)
                save_depth(folder / name / "sparse" / f"{number}.png", frame.sparse_depth)

    def make_reader(self, folder: Path) -> RgbdFolder:
        return RgbdFolder(folder, scale=256.0, validation=0, test=0)


class TestPointsWithoutTruth(TestVideosWithPointsOfTheirOwn):
    """Sparse points as .npy files of metres, matrices as .npy, and nothing to compare with."""

    has_ground_truth = False

    def write_dataset(self, folder: Path, recordings: Recordings) -> None:
        for name, frames in recordings.items():
            (folder / name / "sparse_depth").mkdir(parents=True)
            np.save(folder / name / "K.npy", frames[0].intrinsics)
            for number, frame in enumerate(frames):
                save_image(folder / name / "color" / f"{number}.png", frame.image)
                np.save(folder / name / "sparse_depth" / f"{number}.npy", frame.sparse_depth)


def whole(folder: Path, **options: object) -> RgbdFolder:
    """A reader with all frames in the training split."""
    return RgbdFolder(folder, **({"validation": 0.0, "test": 0.0} | options))  # type: ignore[arg-type]


def test_one_video_is_named_after_its_folder(tmp_path: Path) -> None:
    frames = list(video(12))
    found = with_sources(whole(write_video(tmp_path / "hall", frames)), (-1,))
    assert [target.name for target, _ in found] == [f"frame_{number}" for number in range(1, 12)]
    reader = whole(tmp_path / "hall")
    target = FrameReference("hall", "frame_10")
    np.testing.assert_array_equal(reader.image(target), frames[10].image)
    np.testing.assert_allclose(reader.pose(target), frames[10].pose)


def test_no_point_is_sampled_where_the_sensor_stored_its_largest_value(tmp_path: Path) -> None:
    """7-Scenes' mark for no depth: 65.5 m at a scale of 1000, and at corners of the image as likely as anywhere."""
    folder = write_video(tmp_path / "hall", list(video(2)))
    marked = np.random.default_rng(0).random((16, 24)) < 0.5
    save_depth(folder / "depth" / "frame_1.png", np.where(marked, 65.535, 2.0), 1000.0)
    reader = whole(folder, density=0.2)
    frame = FrameReference("hall", "frame_1")
    np.testing.assert_array_equal(reader.ground_truth(frame), np.where(marked, 0, 2).astype(np.float32))
    assert set(np.unique(reader.sparse_depth(frame))) == {0.0, 2.0}


def test_gap(tmp_path: Path) -> None:
    found = with_sources(whole(write_video(tmp_path / "hall", list(video(12))), gap=4), (-1, 1))
    assert [(t.target.name, *(s.name for s in t.sources)) for t in found] == [
        ("frame_4", "frame_0", "frame_8"),
        ("frame_5", "frame_1", "frame_9"),
        ("frame_6", "frame_2", "frame_10"),
        ("frame_7", "frame_3", "frame_11"),
    ]


def test_splits_are_blocks_that_share_no_frame(tmp_path: Path) -> None:
    write_video(tmp_path / "hall", list(video(40)))
    reader = RgbdFolder(tmp_path / "hall", validation=0.15, test=0.25, margin=3)
    numbers = {
        split: [int(t.target.name[6:]) for t in with_sources(reader, (-1, -2), split)]
        for split in ("train", "validation", "test")
    }
    assert numbers == {"train": [*range(2, 18)], "validation": [*range(21, 27)], "test": [*range(30, 40)]}
    sources = {split: _sources(reader, split) for split in numbers}
    assert sources["train"] <= set(range(18))
    assert sources["validation"] == set(range(19, 26))
    assert sources["test"] == set(range(28, 39))


def _sources(reader: RgbdFolder, split: str) -> set[int]:
    return {int(source.name[6:]) for t in reader.triplets(split, (-1, -2)) for source in t.sources}


def test_frames_at_the_end_of_a_test_split_are_evaluated_all_the_same(tmp_path: Path) -> None:
    reader = RgbdFolder(write_video(tmp_path / "hall", list(video(20))), validation=0, test=0.2, margin=0)
    found = reader.triplets("test", (-1, 1))
    assert [(int(t.target.name[6:]), len(t.sources)) for t in found] == [(16, 0), (17, 2), (18, 2), (19, 0)]


def test_whole_videos_make_up_a_split(tmp_path: Path) -> None:
    for number in range(1, 11):
        write_video(tmp_path / f"room_{number}", list(video(3)))
    reader = RgbdFolder(tmp_path, split_by="videos", validation=0.1, test=0.2)
    found = {s: {t.target.sequence for t in reader.triplets(s, (-1,))} for s in ("train", "validation", "test")}
    assert found["test"] == {"room_9", "room_10"}
    assert found["validation"] == {"room_8"}
    assert found["train"] == {f"room_{number}" for number in range(1, 8)}


def test_a_camera_that_stands_makes_no_training_frames(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    moving = list(video(5))
    frames = [frame for frame in moving for _ in range(2)]  # every frame twice
    reader = whole(write_video(tmp_path / "hall", frames))
    with caplog.at_level(logging.WARNING):
        found = with_sources(reader, (-1,))
        with_sources(reader, (-2,))
    assert [(t.target.name[-1], t.sources[0].name[-1]) for t in found] == [
        ("2", "0"),
        ("4", "2"),
        ("6", "4"),
        ("8", "6"),
    ]
    assert [r.getMessage() for r in caplog.records] == [f"{tmp_path}/hall, train: 5 of 10 frames: 5 static"]
    assert len(with_sources(whole(tmp_path / "hall", min_distance=0.0, min_angle=0.0), (-1,))) == 9
    assert len(RgbdFolder(tmp_path / "hall", validation=0, test=0.4, margin=0).triplets("test", ())) == 4


def test_without_poses_static_frames_are_found_by_their_images(tmp_path: Path) -> None:
    frames = [frame for frame in video(4) for _ in range(2)]
    folder = write_video(tmp_path / "hall", frames, poses=False)
    assert len(with_sources(whole(folder), (-1,))) == 7
    assert len(with_sources(whole(folder, min_difference=1.0), (-1,))) == 3


def test_a_camera_that_never_moves_is_reported_as_such(tmp_path: Path) -> None:
    still = [next(iter(video(1)))] * 5
    posed, unposed = write_video(tmp_path / "hall", still), write_video(tmp_path / "attic", still, poses=False)
    moved = r"camera does not move, all frames are within data\.min_distance=0\.01 m and data\.min_angle=1 degrees"
    with pytest.raises(MissingSplit, match=moved):
        whole(posed).triplets("train", (-1,))
    with pytest.raises(MissingSplit, match=r"does not move, all frames are .* data\.min_difference=1 grey levels"):
        whole(unposed, min_difference=1.0).triplets("train", (-1,))
    assert len(whole(write_video(tmp_path / "single", still[:1])).triplets("train", (-1,))) == 1


def test_frames_without_depth_or_pose_are_counted(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    folder = write_video(tmp_path / "hall", list(video(10)))
    poses = np.loadtxt(folder / "poses.txt")
    poses[4] = np.nan
    np.savetxt(folder / "poses.txt", poses)
    (folder / "depth/frame_7.png").unlink()
    with caplog.at_level(logging.WARNING):
        found = with_sources(whole(folder), (-1,))
    assert [(t.target.name[-1], t.sources[0].name[-1]) for t in found] == [
        ("1", "0"), ("2", "1"), ("3", "2"), ("5", "3"), ("6", "5"), ("8", "7"), ("9", "8"),
    ]  # fmt: skip
    assert [r.getMessage() for r in caplog.records] == [
        f"{folder}: 1 of 10 images has no depth, by name or number.",
        f"{folder}, train: 8 of 10 frames: 1 without pose, 1 without depth",
    ]
    evaluated = RgbdFolder(folder, validation=0, test=0.7, margin=0).triplets("test", (-1,))
    assert [(t.target.name[-1], len(t.sources)) for t in evaluated if len(t.sources) == 0] == [("3", 0), ("4", 0)]
    assert len(evaluated) == 6


def test_depth_is_found_by_number_where_some_names_coincide(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """Images 1.png to 12.png beside depth 01.png to 12.png: the last three are of one name."""
    folder = write_video(tmp_path / "hall", list(video(12)), name="{}")
    for number in range(12):
        (folder / "depth" / f"{number}.png").rename(folder / "depth" / f"{number:02}.png")
    with caplog.at_level(logging.WARNING):
        assert [frame.name for frame in whole(folder).frames()] == [str(number) for number in range(12)]
    assert not caplog.records


def test_poses_and_matrices_of_frames_are_found_by_number(tmp_path: Path) -> None:
    folder = write_video(tmp_path / "hall", frames := list(video(4)), poses=False)
    for number, frame in enumerate(frames):
        save_matrix(folder / "poses" / f"pose_{number:05}.txt", frame.pose)
        save_matrix(folder / "intrinsics" / f"K_{number:05}.txt", np.diag([2.0, 2.0, 1.0]) @ frame.intrinsics)
    reader = whole(folder)
    for number, frame in enumerate(frames):
        named = FrameReference("hall", f"frame_{number}")
        np.testing.assert_allclose(reader.pose(named), frame.pose)
        np.testing.assert_array_equal(reader.intrinsics(named), np.diag([2.0, 2.0, 1.0]) @ frame.intrinsics)
    for number in (2, 3):  # two files that are of the two cameras rather than of the first frames
        (folder / "intrinsics" / f"K_{number:05}.txt").unlink()
    np.testing.assert_array_equal(whole(folder).intrinsics(FrameReference("hall", "frame_0")), frames[0].intrinsics)


def test_short_videos_without_training_frames_are_named(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    for name, count in (("long", 40), ("short", 12), ("tiny", 9)):
        write_video(tmp_path / name, list(video(count)))
    with caplog.at_level(logging.WARNING):
        RgbdFolder(tmp_path).triplets("train", (-1,))
    assert [r.getMessage() for r in caplog.records] == [
        f"{tmp_path}, train: 18 of 43 frames: 25 between splits",
        f"{tmp_path}: 2 of 3 videos have no training frames (short, tiny) with data.validation=0.1, data.test=0.2 and "
        "data.margin=5: set data.margin=2 or data.split_by=videos to leave some.",
    ]
    caplog.clear()
    with caplog.at_level(logging.WARNING):
        assert {t.target.sequence for t in RgbdFolder(tmp_path, margin=2).triplets("train", (-1,))} == {
            "long",
            "short",
            "tiny",
        }
        RgbdFolder(tmp_path, split_by="videos").triplets("train", (-1,))
    assert [r.getMessage() for r in caplog.records] == [f"{tmp_path}, train: 31 of 43 frames: 12 between splits"]


def test_points_may_have_a_unit_of_their_own(tmp_path: Path) -> None:
    folder = write_video(tmp_path / "hall", frames := list(video(2)))
    frame = FrameReference("hall", "frame_1")
    with pytest.raises(
        DeuxError, match=r"data\.sparse_scale=256 is for sparse points, but .*hall has no folder sparse"
    ):
        whole(folder, sparse_scale=256.0).sparse_depth(frame)
    for number in (0, 1):
        save_depth(folder / "sparse" / f"frame_{number}.png", frames[number].sparse_depth, 256.0)
    reader = whole(folder, sparse_scale=256.0)
    points, truth = reader.sparse_depth(frame), reader.ground_truth(frame)
    np.testing.assert_allclose(points[points > 0], truth[points > 0], atol=0.005)
    with pytest.raises(DeuxError, match=r"data\.sparse_scale is 0"):
        whole(folder, sparse_scale=0.0)


def test_images_of_another_format_are_named_as_what_is_missing(tmp_path: Path) -> None:
    folder = write_video(tmp_path / "hall", list(video(2)))
    for number in (0, 1):
        (folder / "rgb" / f"frame_{number}.png").rename(folder / "rgb" / f"frame_{number}.heic")
    with pytest.raises(DeuxError, match=r"hall/rgb contains no images: \.png, \.jpg, .*\.webp files are expected\.$"):
        whole(folder).frames()


@pytest.mark.parametrize("suffix", [".bmp", ".tif", ".webp"])
def test_images_of_other_formats_are_read(tmp_path: Path, suffix: str) -> None:
    folder = write_video(tmp_path / "hall", frames := list(video(2)))
    for number, frame in enumerate(frames):
        file = folder / "rgb" / f"frame_{number}.png"
        Image.fromarray(frame.image).save(file.with_suffix(suffix), lossless=True)
        file.unlink()
    reader = whole(folder)
    for frame, recorded in zip(reader.frames(), frames, strict=True):
        np.testing.assert_array_equal(reader.image(frame), recorded.image)


def test_where_a_video_has_points_none_are_sampled(tmp_path: Path) -> None:
    folder = write_video(tmp_path / "hall", frames := list(video(4)))
    for number in (0, 1, 3):
        save_depth(folder / "sparse" / f"frame_{number}.png", frames[number].sparse_depth, 1000.0)
    assert [t.target.name[-1] for t in with_sources(whole(folder), (-1,))] == ["1", "3"]


def test_the_cameras_matrix(tmp_path: Path) -> None:
    folder = write_video(tmp_path / "rooms/hall", list(video(2)))
    frame = FrameReference("hall", "frame_1")
    (folder / "K.txt").rename(tmp_path / "rooms/K.txt")
    whole(tmp_path / "rooms").intrinsics(frame)
    own = np.array([[30.0, 0.0, 11.0], [0.0, 31.0, 7.0], [0.0, 0.0, 1.0]])
    save_matrix(folder / "intrinsics/frame_1.txt", own)
    np.testing.assert_array_equal(whole(tmp_path / "rooms").intrinsics(frame), own)
    np.testing.assert_array_equal(
        whole(tmp_path / "rooms", fx=1, fy=2, cx=3, cy=4).intrinsics(frame), [[1, 0, 3], [0, 2, 4], [0, 0, 1]]
    )
    with pytest.raises(
        DeuxError, match=r"^Frame frame_0 of hall in .*hall has no intrinsics: .*intrinsics contains no"
    ):
        whole(folder).intrinsics(FrameReference("hall", "frame_0"))
    (folder / "intrinsics").rename(folder / "matrices")
    with pytest.raises(DeuxError, match=r"hall has no intrinsics: K\.txt with nine numbers"):
        whole(folder).intrinsics(FrameReference("hall", "frame_0"))
    with pytest.raises(DeuxError, match=r"data\.fx is set: all of"):
        whole(folder, fx=500.0)


def test_depth_of_another_size_than_the_image_is_refused(tmp_path: Path) -> None:
    folder = write_video(tmp_path / "hall", list(video(3)))
    save_depth(folder / "depth/frame_1.png", np.ones((8, 12)), 1000.0)
    with pytest.raises(DeuxError, match=r"frame_1 of hall in .* has an image of 24 x 16 pixels and depth of 12 x 8"):
        whole(folder).sparse_depth(FrameReference("hall", "frame_1"))


def test_what_is_missing_is_named(tmp_path: Path) -> None:
    with pytest.raises(DeuxError, match=r"has no RGB-D video: a folder images or image or rgb or color or colour of"):
        RgbdFolder(tmp_path)
    folder = write_video(tmp_path / "hall", list(video(6)))
    with pytest.raises(DeuxError, match="a folder left of"):
        RgbdFolder(folder, images="left")
    with pytest.raises(DeuxError, match=r"data\.poses is slam\.txt, but .* has no such file or folder"):
        with_sources(whole(folder, poses="slam.txt"), (-1,))
    (folder / "poses").mkdir()
    with pytest.raises(DeuxError, match="hall/poses has no pose of any image"):
        with_sources(whole(folder, poses="poses"), (-1,))
    with pytest.raises(
        DeuxError, match=r"no validation frames .*data\.validation=0\.1 to hold out a tenth of the frames"
    ):
        whole(folder).triplets("validation", ())
    with pytest.raises(DeuxError, match="there is no split 'tests': did you mean test"):
        whole(folder).triplets("tests", ())
    with pytest.raises(DeuxError, match=r"data\.validation \+ data\.test is 1\.1"):
        RgbdFolder(folder, validation=0.5, test=0.6)
    (folder / "depth").rename(folder / "range")
    with pytest.raises(
        DeuxError, match="has no depth maps with the names or numbers of its images: a folder depth or depths"
    ):
        with_sources(whole(folder), (-1,))
    assert len(with_sources(whole(folder, depth="range"), (-1,))) == 5


def test_is_installed(tmp_path: Path) -> None:
    folder = write_video(tmp_path / "hall", list(video(2)))
    assert registry().create("readers", "rgbd_folder", {"gap": 2}, folder) == RgbdFolder(folder, gap=2)


def _warp_errors(reader: RgbdFolder) -> np.ndarray:
    """Mean absolute colour difference (0 to 255) of every fourth frame and its predecessor, warped and as it is."""
    errors = []
    for target, (source,) in with_sources(reader, (-1,))[::4]:
        image, other = (torch.from_numpy(reader.image(f)).permute(2, 0, 1).float() for f in (target, source))
        depth = torch.from_numpy(reader.ground_truth(target))[None, None]
        intrinsics = torch.from_numpy(reader.intrinsics(target)).float()[None]
        pose = source_from_target(reader.pose(target), reader.pose(source))
        found = []
        for motion in (pose, np.eye(4)):
            rebuilt, visible = reproject(
                other[None, None], depth, intrinsics, torch.from_numpy(motion).float()[None, None]
            )
            found.append(float((rebuilt[0, 0] - image).abs().mean(0)[visible[0, 0, 0]].mean()))
        errors.append(found)
    return np.mean(errors, axis=0)


def test_the_lounge_is_rebuilt_from_its_neighbours(shared_data: Callable[[str], Path]) -> None:
    """The folder's README gives 8.9 for right poses and 43.9 for none, over the whole recording."""
    reader = whole(shared_data("rgbd") / "lounge")
    frame = with_sources(reader, (-1,))[0].target
    assert reader.image(frame).shape == (360, 540, 3)
    assert (reader.sparse_depth(frame) > 0).sum() == round(reader.density * 360 * 540)
    valid = reader.ground_truth(frame) > 0
    assert 0.5 < valid.mean() < 0.8
    warped, still = _warp_errors(reader)
    assert warped < 10.0
    assert warped < 0.25 * still
