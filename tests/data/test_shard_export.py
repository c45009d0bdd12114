import io
import json
from pathlib import Path

import numpy as np
import pytest
import webdataset
from exported import splits
from PIL import Image

from deux.data.shard_export import write_shards
from deux.errors import DeuxError


@pytest.fixture
def exported(tmp_path):
    given = splits(tmp_path / "given")
    for _ in write_shards(tmp_path / "shards", given, samples=10):
        pass
    return tmp_path / "shards", given


# The library leaves the last shard for the garbage collector to close.
pytestmark = pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning", "ignore::ResourceWarning")


def stream(folder, split):
    shards = [str(path) for path in sorted(folder.glob(f"{split}-*.tar"))]
    return {sample["__key__"]: sample for sample in webdataset.WebDataset(shards, shardshuffle=False)}


def image(content):
    return np.array(Image.open(io.BytesIO(content)))


def test_shards_stream_by_the_library_that_defines_them(exported):
    folder, given = exported
    assert len(list(folder.glob("train-*.tar"))) == 3
    for split in given:
        samples = stream(folder, split.name)
        assert len(samples) == len(split.triplets)
        for target, sources in split.triplets:
            sample = samples[f"{split.sequence(target)}/{target.name}"]
            assert np.array_equal(image(sample["image.png"]), split.reader.image(target))
            for number, source in enumerate(sources, start=1):
                assert np.array_equal(image(sample[f"source{number}.png"]), split.reader.image(source))
            assert np.array_equal(image(sample["sparse_depth.png"]) / 256.0, split.reader.sparse_depth(target))
            assert np.array_equal(image(sample["ground_truth.png"]) / 256.0, split.reader.ground_truth(target))
            camera = json.loads(sample["camera.json"])
            assert np.array_equal(camera["intrinsics"], split.reader.intrinsics(target))
            for pose, frame in zip(camera["poses"], (target, *sources), strict=True):
                assert np.array_equal(pose, split.reader.pose(frame))


def test_training_samples_are_mixed_and_others_are_not(exported):
    folder, (train, test) = exported
    for split, mixed in ((train, True), (test, False)):
        expected = [f"{split.sequence(target)}/{target.name}" for target, _ in split.triplets]
        keys = list(stream(folder, split.name))
        assert (keys != expected, sorted(keys)) == (mixed, sorted(expected))


def test_the_same_dataset_gives_the_same_bytes(exported, tmp_path):
    folder, given = exported
    for _ in write_shards(tmp_path / "again", given, samples=10):
        pass
    for path in folder.iterdir():
        assert (tmp_path / "again" / path.name).read_bytes() == path.read_bytes()


def test_a_full_disk_is_reported_with_the_shard_that_does_not_fit(tmp_path):
    (tmp_path / "shards").mkdir()
    (tmp_path / "shards/train-000000.tar").symlink_to("/dev/full")
    with pytest.raises(DeuxError, match=r"^The disk is full: .*shards/train-000000\.tar could not be written"):
        list(write_shards(tmp_path / "shards", splits(tmp_path / "given")))


def test_the_documented_loader_gives_batches(exported):
    folder, _ = exported
    text = (Path(__file__).parents[2] / "docs/export.md").read_text()
    code = next(block for block in text.split("```") if block.startswith("python") and "WebLoader" in block)
    names: dict = {}
    exec(code.removeprefix("python").replace("shards/train", f"{folder}/train"), names)
    images, sparse_depth, intrinsics = next(iter(names["loader"]))
    assert images.shape[:2] == (8, 3)
    assert sparse_depth.shape[1:] == images.shape[2:4]
    assert intrinsics.shape == (8, 3, 3)
