from pathlib import Path

import pytest
from exported import splits
from void_layout import walk, write

from deux.data.dataset_reader import DatasetReader
from deux.data.exported_split import read_splits
from deux.errors import DeuxError


def test_no_sequence_is_in_two_splits(tmp_path):
    train, test = splits(tmp_path)
    assert list(train.sequences()) == ["hall-00", "kitchen-00"]
    assert list(test.sequences()) == ["hall-00-test"]
    assert sum(map(len, train.sequences().values())) == len(train.triplets) == 26


def test_training_targets_without_two_source_frames_are_left_out(tmp_path: Path):
    folder = write(tmp_path / "recorded", {"hall-00": walk("hall", 5)})
    (split,) = read_splits({"train": DatasetReader(folder)}, (-1, 1))
    assert [target.name for target, _ in split.triplets] == ["000001", "000002", "000003"]
    (folder / "train_image.txt").rename(folder / "test_image.txt")
    (split,) = read_splits({"test": DatasetReader(folder)}, (-1, 1))
    assert len(split.triplets) == 5


def test_without_any_such_target_there_is_nothing_to_export(tmp_path: Path):
    folder = write(tmp_path / "recorded", {"hall-00": walk("hall", 5)})
    with pytest.raises(
        DeuxError, match=r"no frame of the train split of .* has 2 source frames at the offsets \[-9, -8"
    ):
        read_splits({"train": DatasetReader(folder)}, (-9, -8))
