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


def test_a_target_with_one_source_frame_is_refused(tmp_path: Path):
    folder = write(tmp_path / "one", {"hall-00": walk("hall", 5)})
    with pytest.raises(DeuxError, match=r"has 1 source frames for 000001 of hall-00: .* training needs 2\.$"):
        read_splits({"train": DatasetReader(folder)}, (-1,))
