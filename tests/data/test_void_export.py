"""What the published set-up script makes of the export, by its rules.

It lists a sequence's files by name. In a training sequence it takes the files 30 to N - 41 as targets, and the files
ten places before and after each as its source frames. In a sequence with a listed test frame, every file is a target.
"""

from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from exported import split_with_gaps, splits, zooming_split
from PIL import Image

from deux.contracts import FrameReference, Triplet
from deux.data.void_export import arrange, used_by_setup, write_void
from deux.errors import DeuxError

DENSITIES = ("void_150", "void_500", "void_1500")


class Prepared(NamedTuple):
    image: Path
    sources: tuple[Path, Path]


def set_up(root: Path, density: str) -> dict[str, list[Prepared]]:
    """The targets of each list, as the set-up script would have them."""
    listed = {split: (root / density / f"{split}_image.txt").read_text().split() for split in ("train", "test")}
    tested = {Path(line).parts[-3] for line in listed["test"]}
    found: dict[str, list[Prepared]] = {"train": [], "test": [], "unused": []}
    for folder in sorted((root / density / "data").iterdir()):
        files = {kind: sorted((folder / kind).glob("*.png")) for kind in ("image", "sparse_depth", "validity_map")}
        assert len({len(paths) for paths in files.values()}) == 1
        images = files["image"]
        start, away = (0, 0) if folder.name in tested else (30, 10)
        for place in range(start, len(images) - away - start):
            line = str(images[place].relative_to(root))
            split = next((split for split, lines in listed.items() if line in lines), "unused")
            found[split].append(Prepared(images[place], (images[place - away], images[place + away])))
    return found


def read(path: Path) -> np.ndarray:
    return np.array(Image.open(path))


def beside(image: Path, kind: str) -> Path:
    return image.parents[1] / kind / image.name


@pytest.fixture
def exported(tmp_path):
    given = splits(tmp_path / "given")
    for _ in write_void(tmp_path, given):
        pass
    return tmp_path, given


def test_the_setup_finds_every_target_with_its_own_source_frames(exported):
    root, (train, test) = exported
    for density in DENSITIES:
        found = set_up(root, density)
        assert (len(found["train"]), len(found["test"])) == (len(train.triplets), len(test.triplets))
        for (target, sources), prepared in zip(train.triplets, found["train"], strict=True):
            assert np.array_equal(read(prepared.image), train.reader.image(target))
            for source, path in zip(sources, prepared.sources, strict=True):
                assert np.array_equal(read(path), train.reader.image(source))
        for (target, _), prepared in zip(test.triplets, found["test"], strict=True):
            assert np.array_equal(read(prepared.image), test.reader.image(target))


def test_the_maps_of_each_target(exported):
    root, (train, _) = exported
    for (target, _), prepared in zip(train.triplets, set_up(root, "void_1500")["train"], strict=True):
        sparse = train.reader.sparse_depth(target)
        assert np.array_equal(read(beside(prepared.image, "sparse_depth")) / 256.0, sparse)
        assert np.array_equal(read(beside(prepared.image, "validity_map")), (sparse > 0) * 256)
        assert np.array_equal(read(beside(prepared.image, "ground_truth")) / 256.0, train.reader.ground_truth(target))
        pose = np.loadtxt(beside(prepared.image, "absolute_pose").with_suffix(".txt"))
        assert np.array_equal(pose, train.reader.pose(target)[:3])
        intrinsics = np.loadtxt(prepared.image.parents[1] / "K.txt")
        assert np.array_equal(intrinsics, train.reader.intrinsics(target))


def test_the_sparser_points_are_among_the_denser(exported):
    root, _ = exported
    image = set_up(root, "void_1500")["train"][0].image.relative_to(root / "void_1500")
    few, some, all_points = (read(beside(root / density / image, "sparse_depth")) for density in DENSITIES)
    assert np.array_equal(few[few > 0], some[few > 0])
    assert np.array_equal(some[some > 0], all_points[some > 0])
    total = np.count_nonzero(all_points)
    assert (np.count_nonzero(few), np.count_nonzero(some)) == (round(total * 0.1), round(total / 3))


@pytest.mark.parametrize(("sequence", "frames", "files"), [("hall-00", 15, 110), ("hall-00-test", 13, 13)])
def test_a_frame_is_one_file_under_several_names(exported, sequence, frames, files):
    images = list((exported[0] / "void_1500/data" / sequence / "image").iterdir())
    assert (len({path.stat().st_ino for path in images}), len(images)) == (frames, files)


def test_the_order_of_time_is_that_of_numbers_in_names():
    frames = [FrameReference("hall-00", f"{number}") for number in range(12)]
    triplets = [Triplet(frame, (frames[number - 1],)) for number, frame in enumerate(frames) if number]
    assert arrange(triplets, "time") == frames


def test_in_the_order_of_time_the_setup_takes_what_it_takes(tmp_path):
    given = splits(tmp_path / "given", frames=75)
    for _ in write_void(tmp_path, given, "time"):
        pass
    found = set_up(tmp_path, "void_500")["train"]
    used, total = used_by_setup(given, "time")
    # Of 75 frames of each sequence, 73 are targets; 30 are left out at either end, and ten more at the last.
    assert (len(found), used, total) == (10, 10, 146)
    hall = [triplet.target for triplet in given[0].triplets if triplet.target.sequence == "hall-00"]
    assert np.array_equal(read(found[0].image), given[0].reader.image(hall[28]))
    assert np.array_equal(read(found[0].sources[0]), given[0].reader.image(hall[18]))
    assert np.array_equal(read(found[0].sources[1]), given[0].reader.image(hall[38]))


def test_all_targets_are_used_when_triplets_are_arranged(exported):
    assert used_by_setup(exported[1], "triplets") == (26, 26)


def test_a_sequence_with_several_cameras_has_no_place_in_the_release(tmp_path):
    with pytest.raises(
        DeuxError,
        match=r"format=void supports one camera for each sequence, but in hall-00 .* export_dataset.format=triplets",
    ):
        list(write_void(tmp_path, [zooming_split(tmp_path / "given")]))
    assert not (tmp_path / "void_1500").exists()


def test_images_of_several_sizes_have_no_place_in_a_sequence(tmp_path):
    split = splits(tmp_path / "given")[1]
    written = tmp_path / "given/test/data/hall-00"
    for kind in ("image", "sparse_depth", "ground_truth"):
        file = sorted((written / kind).glob("*.png"))[3]
        Image.fromarray(np.asarray(Image.open(file))[:-2]).save(file)
    told = r"frame 000003 of hall-00 in .* has an image of 48 x 38 pixels and frame 000002 of 48 x 40: they must"
    with pytest.raises(DeuxError, match=told):
        list(write_void(tmp_path, [split]))


def test_a_list_that_would_lack_a_target_is_left_out(tmp_path, caplog):
    split = split_with_gaps(tmp_path / "given")
    list(write_void(tmp_path, [split]))
    for density in DENSITIES:
        assert len((tmp_path / density / "train_image.txt").read_text().split()) == len(split.triplets) == 8
        assert not (tmp_path / density / "train_ground_truth.txt").exists()
    assert caplog.text.count("train_ground_truth.txt is not written") == 1
