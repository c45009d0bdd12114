import numpy as np
import pytest
from exported import splits, zooming_split
from PIL import Image
from same_tensors import assert_same_tensors

from deux.contracts import FrameReference
from deux.data.triplet_export import write_triplets
from deux.errors import DeuxError
from deux_plugins.readers.triplet_images import TripletImages


@pytest.fixture
def exported(tmp_path):
    given = splits(tmp_path / "given")
    for _ in write_triplets(tmp_path / "export", given, tmp_path / "export"):
        pass
    return tmp_path / "export", given


def test_what_is_exported_comes_back_as_the_same_tensors(exported):
    folder, given = exported
    for split in given:
        assert_same_tensors(split, TripletImages(folder))


def test_a_folder_that_was_moved(exported, tmp_path):
    folder, given = exported
    assert_same_tensors(given[0], TripletImages(folder.rename(tmp_path / "elsewhere")))


def test_without_poses_there_are_none(exported):
    folder, _ = exported
    (folder / "data/hall-00/absolute_pose").rename(folder / "poses")
    assert TripletImages(folder).pose(FrameReference("hall-00", "000002")) is None


@pytest.mark.parametrize(
    ("read", "sentence"),
    [
        (
            lambda reader: reader.triplets("validation", (-1, -2)),
            r"has no validation split, whose images validation_image",
        ),
        (
            lambda reader: reader.sparse_depth(FrameReference("hall-00", "000002-1")),
            "has no sparse_depth of source frames",
        ),
        (lambda reader: reader.image(FrameReference("hall-00", "9")), r"9\.png is missing"),
    ],
)
def test_what_is_not_there(exported, read, sentence):
    with pytest.raises(DeuxError, match=sentence):
        read(TripletImages(exported[0]))


def test_what_is_no_export(exported, tmp_path):
    with pytest.raises(DeuxError, match="is not a dataset of triplets: a folder data/ with sequences"):
        TripletImages(tmp_path)
    folder, _ = exported
    Image.fromarray(np.zeros((8, 20, 3), np.uint8)).save(folder / "data/hall-00/image/000002.png")
    with pytest.raises(DeuxError, match=r"is 20 pixels wide, not a multiple of 3"):
        TripletImages(folder).image(FrameReference("hall-00", "000002"))
    (folder / "train_image.txt").write_text("hall.png\n")
    with pytest.raises(DeuxError, match=r"lists 'hall.png', where a path like data/<sequence>/image/<frame>\.png"):
        TripletImages(folder).triplets("train", (-1, -2))


def test_source_frames_of_another_camera_keep_it(tmp_path):
    split = zooming_split(tmp_path / "given")
    list(write_triplets(tmp_path / "export", [split], tmp_path / "export"))
    assert_same_tensors(split, TripletImages(tmp_path / "export"))


def test_a_target_whose_name_ends_as_a_source_frames_does(exported):
    """shot-2 is a target of its own here, and not the second source frame of a target "shot"."""
    folder, _ = exported
    (target, sources), *_ = TripletImages(folder).triplets("test", (-1, -2))
    before = TripletImages(folder)
    expected = [before.image(target), before.sparse_depth(target), before.image(sources[1]), before.pose(sources[1])]
    for path in (folder / "data" / target.sequence).glob(f"*/{target.name}*"):
        path.rename(path.with_name(path.name.replace(target.name, "shot-2")))
    listed = folder / "test_image.txt"
    listed.write_text(
        listed.read_text().replace(f"{target.sequence}/image/{target.name}", f"{target.sequence}/image/shot-2")
    )
    reader = TripletImages(folder)
    (target, sources), *_ = reader.triplets("test", (-1, -2))
    assert (target.name, sources[1].name) == ("shot-2", "shot-2-2")
    found = [reader.image(target), reader.sparse_depth(target), reader.image(sources[1]), reader.pose(sources[1])]
    assert all(np.array_equal(one, other) for one, other in zip(found, expected, strict=True))
