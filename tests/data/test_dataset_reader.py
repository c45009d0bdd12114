"""The layout of our own datasets and of the VOID release."""

import cProfile
import shutil
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from void_layout import dataset, walk, write

from deux.contracts import FrameReference
from deux.data.dataset_reader import DatasetReader
from deux.errors import DeuxError
from deux.io.layout import MANIFEST, list_file
from deux.testing.readers import ReaderSuite, Recordings


class TestVoidRelease(ReaderSuite):
    def write_dataset(self, folder: Path, recordings: Recordings) -> None:
        write(folder, recordings)

    def make_reader(self, folder: Path) -> DatasetReader:
        return DatasetReader(folder)


class TestCollectedDataset(TestVoidRelease):
    takes_offsets = False

    def write_dataset(self, folder: Path, recordings: Recordings) -> None:
        write(folder, recordings, triplets=True)


class TestRecordedVideo(TestVoidRelease):
    """Frames without poses and without truth."""

    has_poses = has_ground_truth = False

    def write_dataset(self, folder: Path, recordings: Recordings) -> None:
        write(folder, recordings, kinds=("image", "sparse_depth"))


def release(folder: Path) -> Path:
    """Names are time stamps; the test split lists some frames of a sequence."""
    root = write(folder / "void_1500", {"stairs": walk("stairs", 12)}, names="15520979{0:02d}.{0:04d}")
    lines = (root / "train_image.txt").read_text().splitlines(keepends=True)
    (root / "test_image.txt").write_text("".join(lines[4:6]))
    return root


def test_the_void_release_is_read_with_its_frame_offset(tmp_path: Path) -> None:
    reader = DatasetReader(release(tmp_path))
    found = [triplet for triplet in reader.triplets("train", (-3, 3)) if triplet.sources]
    assert [target.name[-4:] for target, _ in found] == [f"{i:04d}" for i in range(3, 9)]
    assert [source.name[-4:] for source in found[0].sources] == ["0000", "0006"]
    assert [target.name[-4:] for target, _ in reader.triplets("test", (-1, -2))] == ["0004", "0005"]


@pytest.mark.parametrize("collected", [True, False])
def test_numbers_of_episodes_are_no_part_of_a_place(tmp_path: Path, collected: bool) -> None:
    """A collected dataset has a manifest; names of recordings are taken as they are."""
    names = ("hall-00", "hall-floor1-01", "b-view0002")
    folder = write(tmp_path / "dataset", {name: walk("hall", 3) for name in names})
    if collected:
        (folder / MANIFEST).write_text("{}")
    places = {target.sequence: DatasetReader(folder).place(target) for target in DatasetReader(folder).frames()}
    episodes = {"hall-00": "hall", "hall-floor1-01": "hall-floor1"}
    assert places == {**(episodes if collected else {name: name for name in episodes}), "b-view0002": "b"}


def test_where_the_release_was_listed_does_not_matter(tmp_path: Path) -> None:
    before = DatasetReader(release(tmp_path)).triplets("train", (-1, -2))
    assert DatasetReader((tmp_path / "void_1500").rename(tmp_path / "moved")).triplets("train", (-1, -2)) == before


def test_a_folder_without_data_is_no_dataset(tmp_path: Path) -> None:
    with pytest.raises(DeuxError, match=r"is no dataset: it has no folder data/ with sequences in VOID's layout"):
        DatasetReader(tmp_path)


def test_a_split_that_is_not_there_is_an_error(tmp_path: Path) -> None:
    root = release(tmp_path)
    with pytest.raises(DeuxError, match=r"has no validation split.* it has test, train"):
        DatasetReader(root).triplets("validation", (-1, -2))
    for file in root.glob("*.txt"):
        file.unlink()
    with pytest.raises(DeuxError, match="it has no list files at all"):
        DatasetReader(root).triplets("train", (-1, -2))


def test_a_split_without_frames_is_an_error(tmp_path: Path) -> None:
    root = release(tmp_path)
    (root / "test_image.txt").write_text("\n \n")
    with pytest.raises(DeuxError, match=r"The test split of .* has no frames"):
        DatasetReader(root).triplets("test", (-1, -2))


def test_every_listed_frame_is_a_target_and_those_that_lack_a_source_frame_have_none(tmp_path: Path) -> None:
    reader = DatasetReader(release(tmp_path))
    for offsets in ((-1, -2), (-3, 3), (-9, -10), (-20,)):
        found = reader.triplets("train", offsets)
        assert [int(target.name[-4:]) for target, _ in found] == list(range(12))
        for number, (_, sources) in enumerate(found):
            wanted = [number + offset for offset in offsets]
            assert [int(source.name[-4:]) for source in sources] == (
                wanted if all(0 <= other < 12 for other in wanted) else []
            )


def test_sources_are_found_in_the_order_of_time_whatever_the_names(tmp_path: Path) -> None:
    reader = DatasetReader(write(tmp_path / "video", {"hall": walk("hall", 12)}, names="frame_{}"))
    found = reader.triplets("train", (-1, 1))
    assert {target.name: [source.name for source in sources] for target, sources in found}["frame_9"] == [
        "frame_8",
        "frame_10",
    ]


def test_blank_lines_and_the_ends_of_lines_of_other_systems_are_let_through(tmp_path: Path) -> None:
    root = release(tmp_path)
    before = DatasetReader(root).triplets("train", (-1, -2))
    lines = (root / "train_image.txt").read_text().splitlines()
    (root / "train_image.txt").write_bytes(
        "\r\n".join(["\ufeff" + lines[0], *lines[1:5], "", *lines[5:], " ", ""]).encode()
    )
    assert DatasetReader(root).triplets("train", (-1, -2)) == before


def test_jpeg_images_are_read(tmp_path: Path) -> None:
    root = dataset(tmp_path / "d", triplets=False)
    reader = DatasetReader(root)
    frame = FrameReference("hall-00", "000003")
    png = reader.image(frame)
    for number, file in enumerate(sorted((root / "data").glob("*/image/*.png"))):
        with Image.open(file) as image:
            image.save(
                file.with_suffix((".jpg", ".jpeg", ".JPG")[number % 3]), format="JPEG", quality=97, subsampling=0
            )
        file.unlink()
    before = reader.triplets("train", (-1, -2))  # the list still says .png
    assert len(before) == 16
    assert np.abs(reader.image(frame).astype(int) - png).max() < 12
    (root / "train_image.txt").write_text((root / "train_image.txt").read_text().replace(".png", ".jpg"))
    assert reader.triplets("train", (-1, -2)) == before


def test_a_listed_frame_without_an_image_is_named(tmp_path: Path) -> None:
    root = release(tmp_path)
    for number in (4, 5):
        next((root / "data/stairs/image").glob(f"*{number:04d}.png")).unlink()
    with pytest.raises(
        DeuxError, match=r"image/.*0004\.png, which .*test_image\.txt lists, is missing, and so are 1 mor"
    ):
        DatasetReader(root).triplets("test", (-1, -2))


def test_a_broken_pose_that_no_list_names_makes_no_source_frame(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    root = dataset(tmp_path / "d", triplets=False)
    np.savetxt(root / "data/hall-00/absolute_pose/000003.txt", np.full((4, 4), -np.inf))
    lines = (root / "train_image.txt").read_text().splitlines(keepends=True)
    (root / "train_image.txt").write_text("".join(line for line in lines if "hall-00/image/000003" not in line))
    for _ in range(2):
        found = DatasetReader(root).triplets("train", (-1, -2))
    single = [target.name for target, sources in found if not sources and target.sequence == "hall-00"]
    assert single == ["000000", "000001", "000004", "000005"]
    assert len(caplog.messages) == 1
    assert "absolute_pose/000003.txt is not a pose" in caplog.messages[0]


def test_a_broken_pose_of_a_listed_frame_is_an_error_where_it_is_read(tmp_path: Path) -> None:
    root = dataset(tmp_path / "d", triplets=False)
    np.savetxt(root / "data/hall-00/absolute_pose/000003.txt", np.full((4, 4), -np.inf))
    assert sum(not sources for _, sources in DatasetReader(root).triplets("train", (-1, -2))) == 4
    with pytest.raises(DeuxError, match=r"absolute_pose/000003\.txt is not a pose"):
        DatasetReader(root).pose(FrameReference("hall-00", "000003"))


def test_the_scale_is_the_number_of_stored_values_per_metre(tmp_path: Path) -> None:
    root, frame = dataset(tmp_path / "d"), FrameReference("hall-00", "000003")
    usual, other = DatasetReader(root), DatasetReader(root, scale=1000.0)
    np.testing.assert_allclose(other.sparse_depth(frame), usual.sparse_depth(frame) * 0.256, rtol=1e-6)
    np.testing.assert_allclose(other.ground_truth(frame), usual.ground_truth(frame) * 0.256, rtol=1e-6)
    both = DatasetReader(root, scale=1000.0, ground_truth_scale=256.0)
    np.testing.assert_array_equal(both.ground_truth(frame), usual.ground_truth(frame))
    for options in ({"scale": 0.0}, {"ground_truth_scale": -1.0}):
        with pytest.raises(DeuxError, match=r"^data\.\w*scale is .*: it must be above 0\.$"):
            DatasetReader(root, **options)


@pytest.mark.parametrize("triplets", [True, False])
def test_sequences_can_be_kept_out_of_the_training_for_validation(tmp_path: Path, triplets: bool) -> None:
    root = dataset(tmp_path / "d", triplets=triplets)
    reader = DatasetReader(root, validation=("kitchen-00",))
    train, validation = (reader.triplets(split, (-1, -2)) for split in ("train", "validation"))
    assert {target.sequence for target, _ in train} == {"hall-00"}
    assert {target.sequence for target, _ in validation} == {"kitchen-00"}
    assert train + validation == DatasetReader(root).triplets("train", (-1, -2))
    with pytest.raises(DeuxError, match=r"has no sequence 'kitchen': did you mean kitchen-00"):
        DatasetReader(root, validation=("kitchen",))
    with pytest.raises(DeuxError, match=r"The train split of .* has no frames"):
        DatasetReader(root, validation=("kitchen-00", "hall-00")).triplets("train", (-1, -2))


@pytest.mark.parametrize("line", ["somewhere/else.png", "data/only.png"])
def test_a_list_that_leads_elsewhere_is_an_error(tmp_path: Path, line: str) -> None:
    root = release(tmp_path)
    (root / "train_image.txt").write_text(f"{line}\n")
    with pytest.raises(DeuxError, match=rf"lists {line}, where a path like data/<sequence>/image"):
        DatasetReader(root).triplets("train", (-1, -2))


def test_a_list_that_is_no_text_is_an_error(tmp_path: Path) -> None:
    root = release(tmp_path)
    (root / "train_image.txt").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(DeuxError, match=r"train_image\.txt is not a list of frames"):
        DatasetReader(root).triplets("train", (-1, -2))


def test_a_pose_that_is_missing_among_others_is_named(tmp_path: Path) -> None:
    root = dataset(tmp_path / "d")
    (root / "data/hall-00/absolute_pose/000003.txt").unlink()
    with pytest.raises(DeuxError, match=r"absolute_pose/000003\.txt is missing"):
        DatasetReader(root).pose(FrameReference("hall-00", "000003"))
    shutil.rmtree(root / "data/hall-00/absolute_pose")
    assert DatasetReader(root).pose(FrameReference("hall-00", "000003")) is None


def test_singular_intrinsics_are_named(tmp_path: Path) -> None:
    root = dataset(tmp_path / "d")
    np.savetxt(root / "data/hall-00/K.txt", np.zeros((3, 3)))
    with pytest.raises(DeuxError, match=r"hall-00/K\.txt is not the matrix of a pinhole camera"):
        DatasetReader(root).intrinsics(FrameReference("hall-00", "000003"))


def listed_frames(root: Path, sequences: int, frames: int = 100) -> DatasetReader:
    """A dataset of list files alone."""
    (root / "data").mkdir(parents=True)
    images = [[f"ours/data/room-{s:02d}/image/{i:06d}.png" for i in range(frames)] for s in range(sequences)]
    triplets = ["\t".join(one[i - back] for back in range(3)) for one in images for i in range(2, frames)]
    list_file(root, "train", "triplets").write_text("\n".join(triplets))
    return DatasetReader(root)


def calls_to_open(reader: DatasetReader) -> int:
    """The number of functions, Python's own included, that are called while a dataset is opened."""
    profile = cProfile.Profile()
    profile.runcall(reader.triplets, "train", (-1, -2))
    return sum(entry.callcount for entry in profile.getstats())


def test_opening_a_large_dataset_reads_its_list_and_looks_at_no_frame(
    tmp_path: Path, file_system_calls: Counter[str]
) -> None:
    reader = listed_frames(tmp_path, sequences=1000)
    file_system_calls.clear()
    triplets = reader.triplets("train", (-1, -2))
    assert len(triplets) == 98_000
    assert triplets[-1].sources == (FrameReference("room-999", "000098"), FrameReference("room-999", "000097"))
    assert file_system_calls.total() <= 3


def test_twice_the_frames_take_twice_the_work_to_open(tmp_path: Path) -> None:
    few = calls_to_open(listed_frames(tmp_path / "few", sequences=100))
    many = calls_to_open(listed_frames(tmp_path / "many", sequences=200))
    assert many == pytest.approx(2 * few, rel=0.01)
