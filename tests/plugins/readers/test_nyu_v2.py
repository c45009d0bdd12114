"""The layouts in which NYU Depth V2 is published and extracted."""

import logging
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest
import scipy.io
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

from deux.contracts import FrameReference
from deux.errors import DeuxError
from deux.registry import registry
from deux.testing.readers import RecordedFrame, Recordings, record
from deux_plugins.readers.nyu_v2 import KINECT, NyuV2


class TestSynchronisedVideo(SampledSuite):
    """`rgb_<n>.jpg` and `sync_depth_<n>.png`: PNG images here, so that they come back as they were."""

    @pytest.fixture
    def recordings(self) -> Recordings:
        return in_multiples_of(1000.0, record())

    def write_dataset(self, folder: Path, recordings: Recordings) -> None:
        for scene, frames in recordings.items():
            save_matrix(folder / "sync" / scene / "K.txt", frames[0].intrinsics)
            for number, frame in enumerate(frames):
                save_image(folder / "sync" / scene / f"rgb_{number:05d}.png", frame.image)
                save_depth(folder / "sync" / scene / f"sync_depth_{number:05d}.png", frame.ground_truth, 1000.0)

    def make_reader(self, folder: Path) -> NyuV2:
        return NyuV2(folder, validation=0, density=DENSITY)


class TestFoldersOfImagesAndDepth(TestSynchronisedVideo):
    """`<scene>/{rgb,depth}/<n>.png`, whose source frames are ten frames away unless asked otherwise."""

    def write_dataset(self, folder: Path, recordings: Recordings) -> None:
        for scene, frames in recordings.items():
            save_matrix(folder / scene / "K.txt", frames[0].intrinsics)
            for number, frame in enumerate(frames):
                save_image(folder / scene / "rgb" / f"{number}.png", frame.image)
                save_depth(folder / scene / "depth" / f"{number}.png", frame.ground_truth, 1000.0)

    def make_reader(self, folder: Path) -> NyuV2:
        return NyuV2(folder, gap=1, validation=0, density=DENSITY)


class TestKBNetFamily(SampledSuite):
    """`training/{images,depths}/raw_data/<scene>/<time stamp>.png`, metres x 256."""

    def write_dataset(self, folder: Path, recordings: Recordings) -> None:
        for scene, frames in recordings.items():
            save_matrix(folder / "training/images/raw_data" / scene / "K.txt", frames[0].intrinsics)
            for number, frame in enumerate(frames):
                name = f"raw_data/{scene}/r-1294886360.{208451 + number}-299677{number:04d}.png"
                save_image(folder / "training/images" / name, frame.image)
                save_depth(folder / "training/depths" / name, frame.ground_truth)

    def make_reader(self, folder: Path) -> NyuV2:
        return NyuV2(folder, gap=1, validation=0, density=DENSITY)


def write_labelled(folder: Path, frames: list[RecordedFrame], scenes: list[str]) -> None:
    """nyu_depth_v2_labeled.mat as MATLAB writes it, columns first, and splits.mat, whose numbers begin with 1."""
    with h5py.File(folder / "nyu_depth_v2_labeled.mat", "w") as file:
        file["images"] = np.stack([frame.image.transpose(2, 1, 0) for frame in frames])
        file["depths"] = np.stack([frame.ground_truth.T for frame in frames])
        texts = []
        for number, scene in enumerate(scenes):
            texts.append(
                file.create_dataset(f"#refs#/{number}", data=np.array([[ord(c)] for c in scene], np.uint16)).ref
            )
        file.create_dataset("scenes", data=np.array([texts], dtype=h5py.ref_dtype), dtype=h5py.ref_dtype)
    splits = {"trainNdxs": np.array([[1], [4]], np.uint16), "testNdxs": np.array([[2], [3], [5]], np.uint16)}
    scipy.io.savemat(folder / "splits.mat", splits)


def test_the_labelled_file_with_the_official_split(tmp_path: Path) -> None:
    frames = list(video(5))
    write_labelled(tmp_path, frames, ["kitchen_0004", "kitchen_0004", "office_0001", "office_0001", "bath_0002"])
    save_matrix(tmp_path / "K.txt", frames[0].intrinsics)
    reader = NyuV2(tmp_path, validation=0, density=DENSITY)
    train, test = reader.triplets("train", (-1, 1)), reader.triplets("test", (-1, 1))
    assert [triplet.target for triplet in train] == [
        FrameReference("labelled_kitchen_0004", "0001"),
        FrameReference("labelled_office_0001", "0004"),
    ]
    assert sorted(triplet.target.name for triplet in test) == ["0002", "0003", "0005"]
    assert all(sources == () for _, sources in (*train, *test))
    for target, _ in (*train, *test):
        frame = frames[int(target.name) - 1]
        np.testing.assert_array_equal(reader.image(target), frame.image)
        np.testing.assert_array_equal(reader.ground_truth(target), frame.ground_truth)
        sparse = reader.sparse_depth(target)
        np.testing.assert_array_equal(sparse[sparse > 0], frame.ground_truth[sparse > 0])
        assert reader.pose(target) is None
    held_out = NyuV2(tmp_path, validation=1)
    assert [t.target.name for t in held_out.triplets("validation", ())] == ["0004"]
    assert [t.target.name for t in held_out.triplets("train", ())] == ["0001"]


def test_damaged_matlab_files_are_named(tmp_path: Path) -> None:
    write_labelled(tmp_path, list(video(5)), ["a"] * 5)
    splits = (tmp_path / "splits.mat").read_bytes()
    (tmp_path / "splits.mat").write_bytes(splits[:150])
    with pytest.raises(DeuxError, match=r"splits\.mat cannot be read as a MATLAB file"):
        NyuV2(tmp_path).triplets("test", ())
    (tmp_path / "splits.mat").unlink()
    with pytest.raises(DeuxError, match=r"splits\.mat is missing"):
        NyuV2(tmp_path).triplets("test", ())
    scipy.io.savemat(tmp_path / "splits.mat", {"testNdxs": [7], "trainNdxs": [1]})
    with pytest.raises(DeuxError, match=r"splits\.mat lists image 7, but .* has 5 images"):
        NyuV2(tmp_path).triplets("test", ())
    (tmp_path / "nyu_depth_v2_labeled.mat").write_bytes(b"MATLAB 7.3")
    with pytest.raises(DeuxError, match=r"labeled\.mat is damaged or not a MATLAB 7\.3 file"):
        NyuV2(tmp_path).triplets("test", ())


@pytest.mark.parametrize("scene", ["../../out", "/out", "..", "a/b", ""])
def test_a_scene_whose_results_would_lie_elsewhere_is_refused(tmp_path: Path, scene: str) -> None:
    write_labelled(tmp_path, list(video(5)), ["kitchen_0004"] * 4 + [scene])
    with pytest.raises(DeuxError, match=r"labeled\.mat has a scene '.*': a name like kitchen_0004 is expected\.$"):
        NyuV2(tmp_path).triplets("test", ())


def test_h5py_is_asked_for_where_it_is_needed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_labelled(tmp_path, list(video(5)), ["a"] * 5)
    monkeypatch.setitem(sys.modules, "h5py", None)
    with pytest.raises(DeuxError, match=r'h5py, which is not installed: pip install "deux\[nyu\]"'):
        NyuV2(tmp_path).triplets("test", ())


def test_labelled_images_as_extracted_beside_video(tmp_path: Path) -> None:
    frames = list(video(4))
    for number, frame in enumerate(frames):
        for base in ("sync/kitchen_0001", "sync/study_0002", "test/bath_0001", "train/kitchen_0001"):
            save_image(tmp_path / base / f"rgb_{number:05d}.jpg", frame.image)
            save_depth(tmp_path / base / f"sync_depth_{number:05d}.png", frame.ground_truth, 1000.0)
    reader = NyuV2(tmp_path, validation=1)
    train, validation = (with_sources(reader, (-1,), split) for split in ("train", "validation"))
    test = reader.triplets("test", (-1,))
    assert {(t.target.sequence, len(t.sources)) for t in train} == {("kitchen_0001", 1)}
    assert {t.target.sequence for t in validation} == {"study_0002"}
    assert [(t.target.sequence, t.sources) for t in test] == [("test_bath_0001", ())] * 4
    depth = reader.ground_truth(test[2].target)
    np.testing.assert_allclose(depth, frames[2].ground_truth, atol=0.0005)


def test_video_of_scenes_in_the_test_split_is_left_out(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """The recordings have all scenes, so that a model would be trained, or chosen, by what it is tested on."""
    frames = list(video(5))
    write_labelled(tmp_path, frames, ["kitchen_0001", "kitchen_0003", "office_0006", "kitchen_0002", "store_0001"])
    kept = ("kitchen_0001", "kitchen_0002", "kitchen_0030", "nyu_office_0")
    for scene in (*kept, "kitchen_0003", "office_0006a", "office_0006b", "store_0001", "bath_0001"):
        for number, frame in enumerate(frames[:2]):
            save_image(tmp_path / "sync" / scene / f"rgb_{number}.jpg", frame.image)
            save_depth(tmp_path / "sync" / scene / f"sync_depth_{number}.png", frame.ground_truth, 1000.0)
    save_image(tmp_path / "test/bath_0001/rgb_0.jpg", frames[0].image)
    save_depth(tmp_path / "test/bath_0001/sync_depth_0.png", frames[0].ground_truth, 1000.0)
    reader = NyuV2(tmp_path, validation=1)
    with caplog.at_level(logging.WARNING):
        found = {
            split: {triplet.target.sequence for triplet in reader.triplets(split, (-1,))}
            for split in ("train", "validation", "test")
        }
    assert found == {
        "train": {"kitchen_0001", "kitchen_0002", "kitchen_0030"},
        "validation": {"nyu_office_0"},
        "test": {"labelled_kitchen_0003", "labelled_office_0006", "labelled_store_0001", "test_bath_0001"},
    }
    assert [record.getMessage() for record in caplog.records] == [
        f"{tmp_path}, video: 8 of 18 frames: 10 of scenes in the test split"
    ]


def test_the_test_images_of_the_kbnet_family(tmp_path: Path) -> None:
    for number, frame in enumerate(video(2)):
        save_image(tmp_path / f"testing/images/{number:04d}.png", frame.image)
        save_depth(tmp_path / f"testing/depths/{number:04d}.png", frame.ground_truth)
    assert len(NyuV2(tmp_path).triplets("test", ())) == 2


def test_source_frames_are_ten_frames_away_in_unthinned_video(tmp_path: Path) -> None:
    for number, frame in enumerate(video(23)):
        save_image(tmp_path / f"bath_0001/rgb/{number}.png", frame.image)
        save_depth(tmp_path / f"bath_0001/depth/{number}.png", frame.ground_truth, 1000.0)
    found = with_sources(NyuV2(tmp_path, validation=0), (-1, 1))
    assert [(t.target.name, t.sources[0].name, t.sources[1].name) for t in found] == [
        ("10", "0", "20"),
        ("11", "1", "21"),
        ("12", "2", "22"),
    ]


def test_the_kinects_matrix_is_for_its_own_size(tmp_path: Path) -> None:
    size = np.zeros((480, 640, 3), np.uint8)
    for number, image in enumerate((size, size, size[:, :-1])):
        save_image(tmp_path / f"bath_0001/rgb_{number}.png", image)
        save_depth(tmp_path / f"bath_0001/sync_depth_{number}.png", np.ones(image.shape[:2]), 1000.0)
    reader = NyuV2(tmp_path)
    np.testing.assert_array_equal(reader.intrinsics(FrameReference("bath_0001", "rgb_1")), KINECT)
    assert KINECT[0, 0] == pytest.approx(518.8579)
    with pytest.raises(DeuxError, match=r"rgb_2\.png has 639 x 480 pixels, but the Kinect's matrix is for 640 x 480"):
        reader.intrinsics(FrameReference("bath_0001", "rgb_2"))


def test_what_is_missing_is_named(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    with pytest.raises(DeuxError, match=r"has no layout of NYU Depth V2: nyu_depth_v2_labeled\.mat, <scene>/rgb_"):
        NyuV2(tmp_path)
    (tmp_path / "bath_0001").mkdir()
    (tmp_path / "bath_0001/r-1294886360.208451-2996770081.ppm").touch()
    with pytest.raises(DeuxError, match=r"has the raw recordings.*the dataset.s toolbox"):
        NyuV2(tmp_path)
    for number, frame in enumerate(video(3)):
        save_image(tmp_path / f"bath_0001/rgb_{number}.jpg", frame.image)
        save_depth(tmp_path / f"bath_0001/sync_depth_{number + 1}.png", frame.ground_truth, 1000.0)
    with caplog.at_level(logging.WARNING):
        assert len(with_sources(NyuV2(tmp_path, validation=0), (-1,))) == 2
    assert [record.getMessage() for record in caplog.records] == [f"{tmp_path}: 2 of 3 frames: 1 without depth"]
    with pytest.raises(DeuxError, match=r"no test frames.*with splits\.mat, test/<scene>"):
        NyuV2(tmp_path).triplets("test", ())


def test_is_installed(tmp_path: Path) -> None:
    save_image(tmp_path / "bath_0001/rgb_0.png", np.zeros((2, 2, 3), np.uint8))
    assert registry().create("readers", "nyu_v2", {"gap": 3, "scale": None}, tmp_path) == NyuV2(tmp_path, 3)
