"""Lists of triplets by each way to choose source frames, whatever the reader knows."""

import logging
import shutil
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from exported import Zooming, splits
from toy_world import ROOM, ToyScene, ToySimulator
from void_layout import dataset, write

from deux.contracts import Action, FrameReference, Reader, Triplet
from deux.data.chosen_sources import count_without_sources, list_triplets
from deux.data.dataset_reader import DatasetReader
from deux.data.triplet_export import write_triplets
from deux.data.triplets import SampleSettings, TripletDataset
from deux.errors import DeuxError
from deux.geometry.poses import motion
from deux.io.layout import SourceChoice
from deux.testing.readers import RecordedFrame
from deux_plugins.readers.rgbd_folder import RgbdFolder
from deux_plugins.readers.triplet_images import TripletImages

TURNS = [Action.FORWARD, Action.LEFT, Action.LEFT, Action.LEFT, Action.FORWARD, Action.RIGHT, Action.RIGHT] * 2


def walk(actions: Sequence[Action] = TURNS) -> list[RecordedFrame]:
    simulator = ToySimulator(ToyScene("hall", "toy-hall"))
    simulator.reset(float(ROOM[0, 0] + 1.0), 1.0, -0.6)
    rng, found = np.random.default_rng(0), []
    for action in actions:
        simulator.step(action)
        frame = simulator.observe()
        sparse = np.where(rng.random(frame.depth.shape) < 0.05, frame.depth, 0.0)
        found.append(RecordedFrame(frame.rgb, sparse, frame.depth, simulator.camera.intrinsics, frame.pose))
    return found


def distances(reader: DatasetReader, choice: str) -> dict[str, float]:
    """Metres between each target and the farther of its sources."""
    return {
        target.name: max(motion(reader.pose(target), reader.pose(source))[0] for source in sources)  # type: ignore[arg-type]
        for target, sources in list_triplets(reader, "train", choice)  # type: ignore[arg-type]
        if sources
    }


@pytest.mark.parametrize("listed", [True, False])
def test_a_folder_without_that_list_has_its_sources_chosen_by_the_poses(tmp_path: Path, listed: bool) -> None:
    """Datasets of earlier versions list t-1 and t-2 alone; elsewhere an image list names the targets."""
    reader = DatasetReader(write(tmp_path / "d", {"hall-00": walk()}, triplets=listed))
    recent, chosen = distances(reader, "recent"), distances(reader, "baseline")
    assert list(chosen) == [f"{i:06d}" for i in range(2 if listed else 0, len(TURNS))]
    assert min(recent.values()) < 0.01  # two turns
    assert min(chosen.values()) > 0.2
    assert max(chosen.values()) < 0.8


def test_offsets_that_are_not_used_are_reported_once(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    reader = DatasetReader(write(tmp_path / "d", {"hall-00": walk()}))
    assert list_triplets(reader, "train", "baseline", (-3, 3)) == list_triplets(reader, "train", "baseline")
    list_triplets(reader, "train", "baseline", (-3, 3))
    assert [record.message for record in caplog.records if record.levelno == logging.WARNING] == [
        f"training.offsets=[-3, 3] is not used: the source frames of {reader.folder} are chosen by their parallax; "
        "training.sources=recent takes those at the offsets."
    ]


def test_source_frames_of_another_camera_are_reported_where_poses_are_learned(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    settings = SampleSettings(training=True, poses=False)
    folder = write(tmp_path / "d", {"hall-00": walk()}, triplets=True)
    TripletDataset([DatasetReader(folder)], "train", settings)
    assert not caplog.records
    TripletDataset([Zooming(folder)], "train", replace(settings, sources="unread"))
    TripletDataset([Zooming(folder)], "train", replace(settings, poses=True))  # which take the cameras along
    assert not caplog.records
    for _ in range(2):  # as in two epochs
        TripletDataset([Zooming(folder)], "train", settings)
    (record,) = caplog.records
    assert "frame 000001 of hall-00 has other intrinsics than 000002, whose source frame it is" in record.message


def test_frames_without_poses_have_the_recent_sources(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    folder = write(tmp_path / "d", {"hall-00": walk()}, kinds=("image", "sparse_depth"))
    reader = DatasetReader(folder)
    with caplog.at_level(logging.INFO):
        assert list_triplets(reader, "train", "baseline", (-1, 1)) == reader.triplets("train", (-1, 1))
    assert f"{folder} has no poses of hall-00: its source frames are those at training.offsets" in caplog.text


def test_what_a_dataset_lists_is_taken_as_it_is(tmp_path: Path) -> None:
    folder = dataset(tmp_path / "d")
    images = [f"d/data/hall-00/image/00000{i}.png" for i in (0, 3, 5)]
    (folder / "train_triplets_baseline.txt").write_text("\t".join(images) + "\n")
    shutil.rmtree(folder / "data/hall-00/absolute_pose")  # nothing of it is read
    (found,) = list_triplets(DatasetReader(folder), "train", "baseline")
    assert found.target == FrameReference("hall-00", "000000")
    assert [source.name for source in found.sources] == ["000003", "000005"]
    kept_out = DatasetReader(folder, validation=("hall-00",))
    assert list_triplets(kept_out, "validation", "baseline") == [found]


def test_a_frame_that_no_list_names_and_whose_pose_is_broken_is_no_source(tmp_path: Path) -> None:
    folder = write(tmp_path / "d", {"hall-00": walk()}, triplets=True)
    (folder / "data/hall-00/absolute_pose/000000.txt").write_text("nan")
    reader = DatasetReader(folder)
    used = {source.name for _, sources in list_triplets(reader, "train", "baseline") for source in sources}
    assert used >= {"000001", "000002"}
    assert "000000" not in used


def test_readers_of_video_give_the_frames_around_a_target(tmp_path: Path) -> None:
    """An RGB-D folder, in which every frame has depth; source frames are `gap` times as far away."""
    frames = walk([Action.LEFT, Action.FORWARD] * 12)
    source = write(tmp_path / "d", {"hall-00": frames}) / "data/hall-00"
    video = tmp_path / "video"
    shutil.copytree(source / "image", video / "images")
    shutil.copytree(source / "ground_truth", video / "depth")
    np.savetxt(video / "K.txt", frames[0].intrinsics)
    np.savetxt(video / "poses.txt", np.stack([frame.pose.ravel() for frame in frames]))
    reader = RgbdFolder(video, scale=256.0, validation=0, test=0, gap=2)
    names = [f"{i:06d}" for i in range(len(frames))]
    around = {one.target.name: one.frames for one in reader.neighbourhoods("train", 3)}
    assert {step: frame.name for step, frame in around["000009"].items()} == {
        step: names[9 + 2 * step] for step in (-3, -2, -1, 1, 2, 3)
    }
    assert set(around["000000"]) == {1, 2, 3}
    found = list_triplets(reader, "train", "baseline")
    assert all(len(sources) == 2 for _, sources in found)
    moved = [motion(reader.pose(t), reader.pose(s))[0] for t, sources in found for s in sources]  # type: ignore[arg-type]
    assert np.mean([0.15 <= metres <= 0.8 for metres in moved]) > 0.9  # the walk ends at a wall


def test_what_lists_its_own_sources_keeps_them(tmp_path: Path) -> None:
    for _ in write_triplets(tmp_path / "export", splits(tmp_path), tmp_path / "export"):
        pass
    reader = TripletImages(tmp_path / "export")
    assert list_triplets(reader, "train", "baseline") == reader.triplets("train", (-1, -2))


def test_a_clip_of_three_frames_has_its_other_two_as_sources(tmp_path: Path) -> None:
    """Nothing is to be chosen there, but the two do not lie at training.offsets."""
    names = [f"clip-{number:02d}" for number in range(3)]
    folder = write(tmp_path / "d", dict.fromkeys(names, walk([Action.FORWARD] * 3)))
    listed = "".join(f"d/data/{name}/image/000001.png\n" for name in names)
    (folder / "train_image.txt").write_text(listed)
    found = list_triplets(DatasetReader(folder), "train", "baseline")
    assert [target for target, _ in found] == [FrameReference(name, "000001") for name in names]
    assert all({source.name for source in sources} == {"000000", "000002"} for _, sources in found)


def test_the_error_names_why_no_frame_has_sources(tmp_path: Path) -> None:
    reader = DatasetReader(write(tmp_path / "d", {"hall-00": walk([Action.FORWARD] * 2)}))
    with pytest.raises(DeuxError, match=r"None of the 2 train frames of .* has source frames: .*training\.sources"):
        TripletDataset([reader], "train", SampleSettings(), choice="baseline")
    assert len(TripletDataset([reader], "train", SampleSettings(sources="unread"), choice="baseline")) == 2


@pytest.mark.parametrize("kind", ["posed", "listed", "without poses", "one with poses", "three frames"])
def test_frames_without_sources_are_counted_without_reading_points(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str
) -> None:
    frames = walk()[: 3 if kind == "three frames" else None]
    folder = write(tmp_path / "d", {"hall-00": frames, "hall-01": walk()[:5]}, triplets=kind == "listed")
    for number in {"without poses": (0, 1), "one with poses": (1,)}.get(kind, ()):
        shutil.rmtree(folder / f"data/hall-0{number}/absolute_pose")
    reader = DatasetReader(folder)
    for choice in ("recent", "baseline"):
        for offsets in ((-1, -2), (-3, 3)):
            lacking = sum(not t.sources for t in list_triplets(reader, "train", choice, offsets))  # type: ignore[arg-type]
            with monkeypatch.context() as patched:
                patched.setattr(DatasetReader, "sparse_depth", None)
                assert count_without_sources(reader, "train", choice, offsets) == lacking  # type: ignore[arg-type]


def test_frames_beside_lost_poses_are_counted(tmp_path: Path) -> None:
    video = tmp_path / "hall"
    folder = write(tmp_path / "d", {"hall-00": walk()}, triplets=False)
    for kind, name in (("image", "images"), ("ground_truth", "depth")):
        shutil.copytree(folder / "data/hall-00" / kind, video / name)
    shutil.copy(folder / "data/hall-00/K.txt", video)
    poses = [frame.pose.ravel() for frame in walk()]
    for number in (*range(1, 8), 9):  # frame 0 has no neighbour with a pose
        poses[number] = np.full(16, np.nan)
    np.savetxt(video / "poses.txt", poses)
    reader = RgbdFolder(video, test=0.0, validation=0.0, min_distance=0.0, min_angle=0.0)
    lacking = sum(not triplet.sources for triplet in list_triplets(reader, "train", "baseline"))
    assert count_without_sources(reader, "train", "baseline", (-1, -2)) == lacking


@pytest.mark.parametrize("choice", ["recent", "baseline"])
def test_the_reader_is_named_for_what_are_no_triplets(tmp_path: Path, choice: SourceChoice) -> None:
    @dataclass(frozen=True)
    class Plain(Reader):
        folder: Path
        image = intrinsics = sparse_depth = None  # type: ignore[assignment]

        def triplets(self, split: str, offsets: tuple[int, ...]) -> list[Triplet]:
            return [(FrameReference("hall-00", "000001"), ())]  # type: ignore[list-item]

    for listing in (list_triplets, count_without_sources):
        with pytest.raises(DeuxError, match=r"^the `triplets` of the reader Plain gives \("):
            listing(Plain(tmp_path), "train", choice, (-1, -2))  # type: ignore[operator]
