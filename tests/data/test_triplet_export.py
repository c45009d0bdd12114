from pathlib import Path

import numpy as np
import pytest
from exported import split_with_gaps, splits, zooming_split
from PIL import Image

from deux.contracts import FrameReference, Triplet
from deux.data.exported_split import ExportedSplit
from deux.data.triplet_export import write_triplets
from deux.errors import DeuxError
from deux_plugins.readers.triplet_images import TripletImages


@pytest.fixture
def exported(tmp_path):
    given = splits(tmp_path / "given")
    folder = tmp_path / "export"
    for _ in write_triplets(folder, given, folder):
        pass
    return folder, given


def lines(folder: Path, name: str) -> list[Path]:
    return [Path(line) for line in (folder / name).read_text().splitlines()]


def test_a_training_script_reads_the_lists(exported):
    folder, given = exported
    for split in given:
        named = {
            kind: lines(folder, f"{split.name}_{kind}.txt")
            for kind in ("image", "sparse_depth", "validity_map", "ground_truth", "intrinsics")
        }
        assert {len(paths) for paths in named.values()} == {len(split.triplets)}
        assert all(path.is_absolute() and path.is_file() for paths in named.values() for path in paths)
        for number, (target, sources) in enumerate(split.triplets):
            left, middle, right = np.split(np.array(Image.open(named["image"][number])), 3, axis=1)
            assert np.array_equal(middle, split.reader.image(target))
            assert np.array_equal(left, split.reader.image(sources[0]))
            assert np.array_equal(right, split.reader.image(sources[1]))
            sparse = np.array(Image.open(named["sparse_depth"][number])) / 256.0
            assert np.array_equal(sparse, split.reader.sparse_depth(target))
            assert np.array_equal(np.array(Image.open(named["validity_map"][number])), (sparse > 0) * 256)
            truth = np.array(Image.open(named["ground_truth"][number])) / 256.0
            assert np.array_equal(truth, split.reader.ground_truth(target))
            assert np.array_equal(np.load(named["intrinsics"][number]), split.reader.intrinsics(target))


def test_each_target_has_its_own_camera_where_a_sequence_has_several(tmp_path):
    split = zooming_split(tmp_path / "given")
    list(write_triplets(tmp_path / "export", [split], tmp_path / "export"))
    named = lines(tmp_path / "export", "train_intrinsics.txt")
    expected = [split.reader.intrinsics(target) for target, _ in split.triplets]
    assert len({matrix[0, 0] for matrix in expected}) == len(expected) > 1
    np.testing.assert_array_equal([np.load(path) for path in named], expected)
    reader = TripletImages(tmp_path / "export")
    found = [reader.intrinsics(target) for target, _ in reader.triplets("train", (-1, -2))]
    np.testing.assert_array_equal(found, expected)


def test_a_list_that_would_lack_a_target_is_left_out(tmp_path, caplog):
    split = split_with_gaps(tmp_path / "given")
    list(write_triplets(tmp_path / "export", [split], tmp_path / "export"))
    assert len(lines(tmp_path / "export", "train_image.txt")) == len(split.triplets) == 8
    assert not (tmp_path / "export" / "train_ground_truth.txt").exists()
    assert "train_ground_truth.txt is not written: 4 of the 8 targets have no ground_truth" in caplog.text


def test_a_frame_named_as_the_source_frame_of_another_is_refused(tmp_path):
    split = splits(tmp_path / "given")[1]
    target = split.triplets[0].target
    twin = Triplet(FrameReference(target.sequence, f"{target.name}-1"), split.triplets[0].sources)
    named = ExportedSplit("test", split.reader, (split.triplets[0], twin))
    with pytest.raises(DeuxError, match=rf'has a frame "{target.name}-1", the name that .* of "{target.name}"'):
        list(write_triplets(tmp_path / "export", [named], tmp_path / "export"))
