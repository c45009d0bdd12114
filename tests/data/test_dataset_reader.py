"""The layout of our own datasets and of the VOID release."""

import shutil
from pathlib import Path

import numpy as np
import pytest
from void_layout import dataset, walk, write

from deux.contracts import FrameReference
from deux.data.dataset_reader import DatasetReader
from deux.errors import DeuxError
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
    found = reader.triplets("train", (-3, 3))
    assert [target.name[-4:] for target, _ in found] == [f"{i:04d}" for i in range(3, 9)]
    assert [source.name[-4:] for source in found[0].sources] == ["0000", "0006"]
    assert [target.name[-4:] for target, _ in reader.triplets("test", (-1, -2))] == ["0004", "0005"]


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
    with pytest.raises(DeuxError, match=r"The test split of .* has no frames"):
        DatasetReader(root).triplets("test", (-9, -10))


@pytest.mark.parametrize("line", ["somewhere/else.png", "data/only.png"])
def test_a_list_that_leads_elsewhere_is_an_error(tmp_path: Path, line: str) -> None:
    root = release(tmp_path)
    (root / "train_image.txt").write_text(f"{line}\n")
    with pytest.raises(DeuxError, match=rf"lists {line}, where a path like data/<sequence>/image"):
        DatasetReader(root).triplets("train", (-1, -2))


def test_a_list_that_is_no_text_is_an_error(tmp_path: Path) -> None:
    root = release(tmp_path)
    (root / "train_image.txt").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(DeuxError, match=r"train_image\.txt is no list of frames"):
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
    with pytest.raises(DeuxError, match=r"hall-00/K\.txt does not hold"):
        DatasetReader(root).intrinsics(FrameReference("hall-00", "000003"))
