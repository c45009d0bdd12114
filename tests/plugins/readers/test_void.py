"""The layout of the VOID release, as it is unpacked."""

import logging
from pathlib import Path

import numpy as np
import pytest
from exported import splits
from written_frames import save_depth, save_image, save_matrix, video, with_sources

from deux.contracts import FrameReference
from deux.data.void_export import write_void
from deux.errors import DeuxError
from deux.registry import registry
from deux.testing.readers import ReaderSuite, Recordings
from deux_plugins.readers.void import Void

KINDS = ("image", "sparse_depth", "validity_map", "ground_truth", "absolute_pose", "intrinsics")


def write_release(
    folder: Path,
    recordings: Recordings,
    test: tuple[str, ...] = (),
    names: str = "{:.4f}",
    start: float = 1552097916.3,
    step: float = 1 / 30,
) -> Path:
    """One density: all kinds of files and the twelve lists, whose lines begin with the folder's own name."""
    lists: dict[str, list[str]] = {f"{split}_{kind}": [] for split in ("train", "test") for kind in KINDS}
    for sequence, frames in recordings.items():
        base, split = folder / "data" / sequence, "test" if sequence in test else "train"
        save_matrix(base / "K.txt", frames[0].intrinsics)
        for number, frame in enumerate(frames):
            name = names.format(start + number * step)
            save_image(base / f"image/{name}.png", frame.image)
            save_depth(base / f"sparse_depth/{name}.png", frame.sparse_depth)
            save_depth(base / f"validity_map/{name}.png", (frame.sparse_depth > 0).astype(np.float32))
            save_depth(base / f"ground_truth/{name}.png", frame.ground_truth)
            save_matrix(base / f"absolute_pose/{name}.txt", frame.pose[:3])
            for kind in KINDS:
                end = {"absolute_pose": f"absolute_pose/{name}.txt", "intrinsics": "K.txt"}.get(
                    kind, f"{kind}/{name}.png"
                )
                lists[f"{split}_{kind}"].append(f"{folder.name}/data/{sequence}/{end}")
    for name, lines in lists.items():
        if lines:
            (folder / f"{name}.txt").write_text("\n".join(lines) + "\n")
    return folder


class TestVoid(ReaderSuite):
    def write_dataset(self, folder: Path, recordings: Recordings) -> None:
        write_release(folder / "void_1500", recordings)

    def make_reader(self, folder: Path) -> Void:
        return Void(folder, gap=1, margin=0, validation=0)


def test_time_stamps_of_different_lengths_are_in_the_order_of_time(tmp_path: Path) -> None:
    frames = video(5)
    root = write_release(tmp_path / "void_150", {"walk": frames}, names="{:.15g}", start=8.9, step=0.35)
    written = sorted(path.stem for path in (root / "data/walk/image").iterdir())
    assert written == ["10.3", "8.9", "9.25", "9.6", "9.95"]
    found = with_sources(Void(tmp_path, gap=1, margin=0, validation=0), (-1,))
    assert [target.name for target, _ in found] == ["9.25", "9.6", "9.95", "10.3"]
    for (target, (source,)), frame, previous in zip(found, frames[1:], frames, strict=False):
        reader = Void(root, gap=1)
        np.testing.assert_array_equal(reader.image(target), frame.image)
        np.testing.assert_allclose(reader.pose(source), previous.pose)


def test_published_gap_and_margin(tmp_path: Path) -> None:
    root = write_release(tmp_path / "void_1500", {"a": video(80), "b": video(12)}, test=("b",))
    found = with_sources(Void(root, validation=0), (-1, 1))
    names = sorted(path.stem for path in (root / "data/a/image").iterdir())
    assert [target.name for target, _ in found] == names[30:50]
    assert [source.name for source in found[0].sources] == [names[20], names[40]]


def test_offsets_in_frames_beside_a_gap_are_refused(tmp_path: Path) -> None:
    """The published experiments have training.offsets=[-10,10]."""
    root = write_release(tmp_path / "void_1500", {"a": video(24)})
    with pytest.raises(
        DeuxError, match=r"put source frames 100 frames away: set data\.gap=1 to use the offsets as frames"
    ):
        with_sources(Void(root, margin=0, validation=0), (-10, 10))
    assert len(with_sources(Void(root, gap=1, margin=0, validation=0), (-10, 10))) == 4


def test_the_test_split_has_every_frame_of_its_list(tmp_path: Path) -> None:
    root = write_release(tmp_path / "void_1500", {"a": video(3), "b": video(12)}, test=("b",))
    found = Void(root, gap=4, validation=0).triplets("test", (-1, 1))
    assert len(found) == 12
    assert [len(sources) for _, sources in found] == [0] * 4 + [2] * 4 + [0] * 4


def test_listed_frames_that_are_not_there_are_counted(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    root = write_release(tmp_path / "void_1500", {"a": video(6), "b": video(6)}, test=("b",))
    sorted((root / "data/b/sparse_depth").iterdir())[2].unlink()
    reader = Void(root, validation=0)
    with caplog.at_level(logging.WARNING):
        assert len(reader.triplets("test", ())) == 5
        reader.triplets("test", ())
    (message,) = [record.getMessage() for record in caplog.records]
    assert message == f"{root}/test_image.txt: 5 of 6 frames: 1 without image or sparse depth"


def test_validation_sequences_are_the_last_training_sequences(tmp_path: Path) -> None:
    root = write_release(tmp_path / "void_500", {name: video(3) for name in ("a", "b2", "b10", "t")}, test=("t",))
    reader = Void(root, gap=1, margin=0, validation=2)
    split = {s: {target.sequence for target, _ in reader.triplets(s, (-1,))} for s in ("train", "validation", "test")}
    assert split == {"train": {"a"}, "validation": {"b2", "b10"}, "test": {"t"}}
    with pytest.raises(DeuxError, match=r"data\.validation=3 leaves nothing to train on: .* has 3 sequences"):
        with_sources(Void(root, gap=1), (-1,))
    with pytest.raises(DeuxError, match=r"no validation frames.*data\.validation=3 to hold out"):
        Void(root, validation=0).triplets("validation", (-1,))


def test_one_density_is_chosen(tmp_path: Path) -> None:
    for points in (150, 500):
        write_release(tmp_path / f"void_{points}", {"a": video(3)})
    with pytest.raises(DeuxError, match=r"has void_150, void_500: choose one by data\.points=150, 500 or 1500"):
        Void(tmp_path)
    with pytest.raises(DeuxError, match="has void_150, void_500"):
        Void(tmp_path, points=1500)
    with pytest.raises(DeuxError, match="but the folder is"):
        Void(tmp_path / "void_150", points=500)
    reader = Void(tmp_path, points=500, gap=1, margin=0, validation=0)
    image = reader._files(with_sources(reader, (-1,))[0].target).image
    assert image.is_relative_to(tmp_path / "void_500")
    assert Void(tmp_path / "void_500", points=500, gap=1).folder == tmp_path / "void_500"


def test_what_is_not_the_release_is_named(tmp_path: Path) -> None:
    with pytest.raises(DeuxError, match="is not the VOID release"):
        Void(tmp_path)
    root = write_release(tmp_path / "void_150", {"a": video(3)})
    with pytest.raises(DeuxError, match=r"has no test_image\.txt"):
        Void(root).triplets("test", ())
    (root / "train_image.txt").write_text("void_150/a/0.png\n")
    with pytest.raises(DeuxError, match=r"train_image\.txt has the line 'void_150/a/0\.png'"):
        with_sources(Void(root), (-1,))


def test_is_installed(tmp_path: Path) -> None:
    write_release(tmp_path / "void_150", {"a": video(3)})
    assert registry().create("readers", "void", {"points": 150, "gap": 1}, tmp_path) == Void(tmp_path, 150, 1)
    with pytest.raises(DeuxError):
        Void(tmp_path).image(FrameReference("a", "0"))


def test_what_is_exported_as_void_comes_back_as_the_same_tensors(tmp_path: Path) -> None:
    given = splits(tmp_path / "given")
    for _ in write_void(tmp_path / "void_release", given):
        pass
    reader = Void(tmp_path / "void_release", points=1500, validation=0)
    for split in given:
        # The set-up script of the release takes the files ten places before and after a target.
        read = reader.triplets(split.name, (-1, 1))
        for (target, sources), (written, others) in zip(split.triplets, read, strict=True):
            pairs = [(target, written)]
            if split.name == "train":
                pairs += zip(sources, others, strict=True)
            for frame, copy in pairs:
                assert np.array_equal(reader.image(copy), split.reader.image(frame))
                assert np.array_equal(reader.pose(copy), split.reader.pose(frame))
                assert np.array_equal(reader.sparse_depth(copy), split.reader.sparse_depth(frame))
                assert np.array_equal(reader.ground_truth(copy), split.reader.ground_truth(frame))
                assert np.array_equal(reader.intrinsics(copy), split.reader.intrinsics(frame))
