import io
import pickle
import tarfile

import pytest
from exported import splits, zooming_split
from same_tensors import assert_same_tensors

from deux.contracts import FrameReference
from deux.data.shard_export import write_shards
from deux.errors import DeuxError
from deux_plugins.readers.webdataset import Shards


@pytest.fixture
def exported(tmp_path):
    given = splits(tmp_path / "given")
    for _ in write_shards(tmp_path / "shards", given, samples=10):
        pass
    return tmp_path / "shards", given


def test_what_is_exported_comes_back_as_the_same_tensors(exported):
    folder, given = exported
    for split in given:
        assert_same_tensors(split, pickle.loads(pickle.dumps(Shards(folder))))


def test_what_is_not_there(exported):
    reader = Shards(exported[0])
    with pytest.raises(DeuxError, match=r"has no validation split: shards .* it has test, train\.$"):
        reader.triplets("validation", (-1, -2))
    with pytest.raises(DeuxError, match=r"has no sample hall-00/9\.$"):
        reader.image(FrameReference("hall-00", "9"))
    with pytest.raises(DeuxError, match=r"the sample hall-00/000002 of .* has no source3\.png: it has camera\.json"):
        reader.image(FrameReference("hall-00", "000002.source3"))


def test_damaged_shards(exported):
    folder, _ = exported
    shard = folder / "test-000000.tar"
    for content in (shard.read_bytes()[:700], b"no archive"):
        shard.write_bytes(content)
        with pytest.raises(DeuxError, match=r"test-000000\.tar is damaged or not a tar file"):
            Shards(folder).triplets("test", (-1, -2))


@pytest.mark.parametrize(
    "name",
    ["../../hall/0.image.png", "/hall/0.image.png", "hall/../../0.image.png", "a/../hall/0.image.png", "0.image.png"],
)
def test_members_that_lead_out_of_a_folder_are_refused(exported, name):
    folder, _ = exported
    with tarfile.open(folder / "test-000000.tar", "a") as shard:
        shard.addfile(tarfile.TarInfo(name), io.BytesIO())
    with pytest.raises(
        DeuxError, match=r"test-000000\.tar contains '.*0\.image\.png': a relative path <sequence>/<frame>\.<kind>"
    ):
        Shards(folder).triplets("test", (-1, -2))


def test_sequences_may_lie_in_folders(exported):
    folder, given = exported
    for path in folder.glob("*.tar"):
        with tarfile.open(path) as shard, tarfile.open(f"{path}.new", "w") as moved:
            for member in shard:
                content = shard.extractfile(member)
                member.name = f"house/{member.name}"
                moved.addfile(member, content)
        path.with_name(f"{path.name}.new").replace(path)
    found = {target.sequence for target, _ in Shards(folder).triplets("train", ())}
    assert found == {f"house/{sequence}" for sequence in given[0].sequences()}


def test_source_frames_of_another_camera_keep_it(tmp_path):
    split = zooming_split(tmp_path / "given")
    list(write_shards(tmp_path / "shards", [split]))
    assert_same_tensors(split, Shards(tmp_path / "shards"))
