from pathlib import Path

import pytest
from exported import splits
from PIL import Image
from void_layout import dataset, walk, write

from deux.contracts import FrameReference, Triplet
from deux.data.chosen_sources import list_triplets
from deux.data.dataset_reader import DatasetReader
from deux.data.exported_split import ExportedSplit, read_splits
from deux.data.shard_export import write_shards
from deux.data.triplet_export import write_triplets
from deux.data.void_export import write_void
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


def test_training_frames_take_their_chosen_source_frames_with_them(tmp_path):
    """Test frames are those of the test list, whatever the training frames take."""
    readers = {
        s: DatasetReader(dataset(tmp_path / s, split=s, triplets=False)) for s in ("train", "validation", "test")
    }
    recent, baseline = (read_splits(readers, (-1, -2), choice) for choice in ("recent", "baseline"))
    assert len(recent[0].triplets) == 12
    for split, given in zip(baseline[:2], recent[:2], strict=True):
        assert split.triplets == tuple(list_triplets(readers[split.name], split.name, "baseline"))
        assert {one.target for one in split.triplets} > {one.target for one in given.triplets}
    assert baseline[2].triplets == recent[2].triplets


def test_without_any_such_target_there_is_nothing_to_export(tmp_path: Path):
    folder = write(tmp_path / "recorded", {"hall-00": walk("hall", 5)})
    with pytest.raises(
        DeuxError, match=r"no frame of the train split of .* has 2 source frames at the offsets \[-9, -8"
    ):
        read_splits({"train": DatasetReader(folder)}, (-9, -8))


@pytest.mark.parametrize("frame", [("../../hall", "0"), ("/hall", "0"), ("hall", "../0"), ("hall", "a/0")])
def test_frames_whose_files_would_lie_outside_the_export_are_refused(tmp_path: Path, frame):
    reader = DatasetReader(write(tmp_path / "recorded", {"hall-00": walk("hall", 5)}))
    with pytest.raises(DeuxError, match=r"the frame .* cannot be written to the export of .*recorded"):
        ExportedSplit("test", reader, (Triplet(FrameReference(*frame), ()),))


@pytest.mark.parametrize("kind", ["image", "sparse_depth", "ground_truth"])
@pytest.mark.parametrize("export", ["triplets", "void", "webdataset"])
def test_a_frame_of_which_something_has_another_size_is_not_exported(tmp_path: Path, kind, export):
    folder = write(tmp_path / "given", {"hall-00": walk("hall", 6)}, triplets=True)
    file = next(folder.glob(f"data/hall-00/{kind}/*03.png"))
    with Image.open(file) as picture:
        picture.resize((12, 10), Image.Resampling.NEAREST).save(file)
    given = read_splits({"train": DatasetReader(folder)}, (-1, -2))
    writers = {
        "triplets": lambda: write_triplets(tmp_path / "out", given, tmp_path / "out"),
        "void": lambda: write_void(tmp_path / "out", given),
        "webdataset": lambda: write_shards(tmp_path / "out", given, 4),
    }
    with pytest.raises(DeuxError, match=r"^frame 00000\d of hall-00 .* 12 x 10.*: they must have the same size\.$"):
        list(writers[export]())
