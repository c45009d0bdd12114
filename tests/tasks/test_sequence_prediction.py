"""`task=predict predict.data=`: many frames from any layout, to files that a second start finds again."""

import csv
import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image
from scipy.spatial import cKDTree

import deux as package
from deux.contracts import Action
from deux.deployment.model_files import load_model
from deux.geometry.camera import Camera
from deux.geometry.point_cloud import unproject
from deux.io.atomic import write_atomically
from deux.io.camera_files import read_any_depth
from deux.io.images import quantise_depth, read_fraction, write_depth
from deux.io.video_files import VideoReader, VideoWriter
from deux.metrics.depth_errors import METRICS
from deux.tasks import prediction_folder, sequence_prediction
from deux.testing.box_world import Box, BoxWorld
from deux.testing.readers import RecordedFrame

FRAMES = 7
SIZE = (32, 40)


def walk() -> list[RecordedFrame]:
    """A walk through a room; the points are 5 % of the pixels."""
    rng = np.random.default_rng(0)
    world = BoxWorld(4.0, 5.0, (Box(0.5, 0.5, 1.0, 1.2, 0.8),), Camera(SIZE[1], SIZE[0]))
    world.reset(2.0, 4.5, 0.0)
    found = []
    for number in range(FRAMES):
        world.step(Action.FORWARD if number % 3 else Action.LEFT)
        frame = world.observe()
        depth = quantise_depth(frame.depth)
        sparse = np.where(rng.random(depth.shape) < 0.05, depth, np.float32(0))
        found.append(RecordedFrame(frame.rgb, sparse, depth, world.camera.intrinsics, frame.pose))
    return found


def table(run: Path) -> list[dict[str, str]]:
    """The rows of a run's errors."""
    return list(csv.DictReader((run / "errors.csv").read_text().splitlines()))


@pytest.fixture
def recorded() -> list[RecordedFrame]:
    return walk()


@pytest.fixture
def room_folder(tmp_path: Path, recorded: list[RecordedFrame]) -> Path:
    """The walk as folders of images, points and depth with poses."""
    folder = tmp_path / "room"
    for kind in ("images", "sparse", "depth"):
        (folder / kind).mkdir(parents=True)
    for number, frame in enumerate(recorded):
        Image.fromarray(frame.image).save(folder / "images" / f"{number:03d}.png")
        write_depth(folder / "sparse" / f"{number:03d}.png", frame.sparse_depth)
        write_depth(folder / "depth" / f"{number:03d}.png", frame.ground_truth)
    np.savetxt(folder / "K.txt", recorded[0].intrinsics)
    np.savetxt(folder / "poses.txt", [frame.pose.ravel() for frame in recorded])
    return folder


@pytest.fixture
def predict(deux, room_folder, model_file):
    """Run the task on the walk, with other options of the section `predict` where given; the run is in `run`."""

    def run(*more: str, **options: object):
        given = {"data": room_folder, "checkpoint": model_file("kbnet"), "video": "false"} | options
        chosen = [f"predict.{key}={value}" for key, value in given.items() if value is not None]
        where = [] if any(one.startswith("hydra.") for one in more) else [f"hydra.run.dir={room_folder.parent}/run"]
        return deux("task=predict", "data=rgbd_folder", "data.scale=256", *chosen, *where, *more)

    return run


def test_every_frame_gets_what_the_model_predicts_for_it_alone(predict, room_folder, recorded, model_file):
    outcome = predict(format="npy", batch_size=3)
    assert (outcome.code, outcome.err) == (0, "")
    model = load_model(model_file("kbnet"))
    files = sorted((room_folder.parent / "run" / "depth" / "room").iterdir())
    assert [path.name for path in files] == [f"{number:03d}.npy" for number in range(FRAMES)]
    rows = table(room_folder.parent / "run")
    means = dict.fromkeys(METRICS, 0.0)
    for path, row, frame in zip(files, rows, recorded, strict=True):
        expected = package.predict(frame.image, frame.sparse_depth, frame.intrinsics, model=model)
        depth = np.load(path)
        np.testing.assert_allclose(depth, expected, rtol=1e-4)
        unseen = (frame.sparse_depth == 0) & (frame.ground_truth > 0.1)
        mae = 1000 * np.abs(depth - frame.ground_truth)[unseen].mean()
        assert float(row["mae"]) == pytest.approx(mae, rel=1e-4)
        assert int(row["pixels"]) == unseen.sum()
        means = {name: means[name] + float(row[name]) / FRAMES for name in METRICS}
    assert "Mean errors of 7 frames" in outcome.out
    line = next(line for line in outcome.out.splitlines() if "kbnet" in line and "│" in line)
    shown = [float(cell.replace(",", "")) for cell in line.split("│")[2:-1]]
    np.testing.assert_allclose(shown, list(means.values()), rtol=1e-2, atol=0.06)
    assert float(rows[0]["interpolated_mae"]) < float(rows[0]["mae"])


def test_a_batch_that_a_kill_cut_short_is_predicted_as_a_whole_again(predict, room_folder, monkeypatch):
    """A frame's last bits depend on the frames beside it in its batch."""
    run = room_folder.parent / "run"
    sizes: list[int] = []
    original = sequence_prediction.DepthCompleter.__call__

    def counted(self, frames):
        sizes.append(len(frames))
        return original(self, frames)

    def dies(path, content):
        if path.name == "004.png":
            raise KeyboardInterrupt
        write_atomically(path, content)

    monkeypatch.setattr(sequence_prediction.DepthCompleter, "__call__", counted)
    with monkeypatch.context() as killed:
        killed.setattr(prediction_folder, "write_atomically", dies)
        predict(batch_size=3)
    assert (run / "depth" / "room" / "003.png").exists()
    assert len((run / "frames.jsonl").read_text().splitlines()) == 3
    assert predict(batch_size=3).code == 0
    assert sizes == [3, 3, 3, 1]


def test_what_was_done_before_a_kill_is_not_done_again(predict, room_folder, monkeypatch):
    run = room_folder.parent / "run"
    calls: list[int] = []
    original = sequence_prediction.DepthCompleter.__call__

    def dies(self, frames):
        calls.append(len(frames))
        if len(calls) == 3:
            raise KeyboardInterrupt
        return original(self, frames)

    monkeypatch.setattr(sequence_prediction.DepthCompleter, "__call__", dies)
    predict(batch_size=2)
    whole = {path: path.stat().st_mtime_ns for path in (run / "depth").rglob("*.png")}
    assert len(whole) == 4
    with (run / "frames.jsonl").open("a") as journal:
        journal.write('{"sequence": "room", "na')  # a line that was being written
    (run / "depth" / "room" / "002.png").unlink()
    outcome = predict(batch_size=2)
    assert outcome.code == 0
    assert "Predict 7 frames of" in outcome.out
    assert ", 3 of them done before" in outcome.out
    assert sum(calls[3:]) == 4
    assert all(path.stat().st_mtime_ns == time for path, time in whole.items() if path.name != "002.png")
    assert len((run / "frames.jsonl").read_text().splitlines()) == FRAMES
    assert len(table(run)) == FRAMES
    monkeypatch.undo()
    outcome = predict(batch_size=5, export="ply", agreement="null")  # what takes nothing anew
    assert ", 7 of them done before" in outcome.out
    assert (run / "clouds" / "room.ply").exists()


def test_another_model_is_refused_in_a_folder_with_results(predict, room_folder, model_file):
    assert predict().code == 0
    sentence = predict(checkpoint=model_file("scaffnet")).sentence
    assert re.match(r".*/run contains a run with other settings \(predict\.checkpoint: .*hydra\.run\.dir", sentence)
    assert re.match(r".*/run contains a run with other settings \(predict\.format", predict(format="npy").sentence)


@pytest.mark.parametrize("form", ["images", "video"])
def test_images_or_a_video_beside_points(predict, room_folder, recorded, form):
    data, files = room_folder / "images", {"intrinsics": room_folder / "K.txt", "sparse": room_folder / "sparse"}
    if form == "video":
        data = room_folder / "clip.mp4"
        with VideoWriter(data) as video:
            for frame in recorded:
                video.write(frame.image)
    outcome = predict(data=data, ground_truth=room_folder / "depth", **files)
    assert (outcome.code, outcome.err) == (0, "")
    if form == "images":
        other = f"hydra.run.dir={room_folder.parent}/other"
        sentence = predict(other, data=data, sparse_scale=1, **files).sentence
        assert re.match(r"all \d+ points of .*/sparse are out of the model's depth range of 0.1 to 10 m", sentence)
    written = sorted((room_folder.parent / "run" / "depth").rglob("*.png"))
    assert len(written) == FRAMES
    assert read_any_depth(written[0]).shape == SIZE
    assert "Mean errors of 7 frames" in outcome.out


@pytest.mark.parametrize("form", ["ply", "glb"])
def test_the_cloud_is_made_of_the_depth_files(predict, room_folder, recorded, form):
    outcome = predict(export=form, voxel=0, uncertainty="sparse_error", keep=0.5, agreement="null")
    assert (outcome.code, outcome.err) == (0, "")
    run = room_folder.parent / "run"
    expected, colors, sure = [], [], []
    for number, frame in enumerate(recorded):
        depth = read_any_depth(run / "depth" / "room" / f"{number:03d}.png")
        rays = Camera(SIZE[1], SIZE[0]).rays()
        points = (rays * depth[..., None]) @ frame.pose[:3, :3].T + frame.pose[:3, 3]
        expected.append(points.reshape(-1, 3))
        colors.append(frame.image.reshape(-1, 3))
        sure.append(read_fraction(run / "confidence" / "room" / f"{number:03d}.png").ravel())
    (cloud,) = trimesh.load_scene(run / "clouds" / f"room.{form}").dump()
    points, colors, sure = np.concatenate(expected), np.concatenate(colors), np.concatenate(sure)
    assert len(cloud.vertices) == pytest.approx(0.5 * len(points), rel=0.1)  # the quantile is sampled
    kept = np.argsort(-sure, kind="stable")[: len(cloud.vertices)]
    kept = sure >= sure[kept[-1]]
    np.testing.assert_allclose(cloud.vertices, points[kept], atol=1e-4)
    np.testing.assert_array_equal(cloud.colors[:, :3], colors[kept])


def test_points_need_other_frames_that_agree(predict, room_folder, recorded):
    """The depth files are replaced by the true depth, but for one frame that errs by a tenth."""
    assert predict(format="npy").code == 0
    run = room_folder.parent / "run"
    wrong = 4
    for number, frame in enumerate(recorded):
        np.save(run / "depth" / "room" / f"{number:03d}.npy", frame.ground_truth * (1.1 if number == wrong else 1.0))
    counts, errors = {}, {}
    for agreement in ("null", 0.03):
        outcome = predict(format="npy", export="ply", voxel=0, agreement=agreement)
        assert (outcome.code, outcome.err) == (0, "")
        points = trimesh.load(run / "clouds" / "room.ply").vertices
        truth = np.concatenate(
            [unproject(one.ground_truth, one.intrinsics, one.pose).reshape(-1, 3) for one in recorded]
        )
        counts[agreement], errors[agreement] = len(points), cKDTree(truth).query(points)[0]
    assert counts["null"] == FRAMES * SIZE[0] * SIZE[1]
    assert 0.3 * counts["null"] < counts[0.03] < 0.9 * counts["null"]
    assert np.mean(errors[0.03] > 0.1) < 0.2 * np.mean(errors["null"] > 0.1)


def test_a_video_has_all_frames(predict, room_folder):
    assert predict(video="true", uncertainty="l1").code == 0
    video = VideoReader(room_folder.parent / "run" / "videos" / "room.mp4")
    assert len(video) == FRAMES
    assert video.read(FRAMES - 1).shape == (SIZE[0], 3 * SIZE[1], 3)


def test_a_recording_has_all_frames(predict, room_folder):
    chunk = pytest.importorskip("rerun.chunk")
    assert predict(viewer="rerun").code == 0
    reader = chunk.RrdReader(room_folder.parent / "run" / "recordings" / "room.rrd")
    entities = {one.entity_path for one in reader.stream(store=reader.recordings()[0])}
    assert {f"/world/cloud/{number}" for number in range(FRAMES)} < entities


def test_frames_of_one_split(predict, room_folder):
    outcome = predict(split="test")
    assert outcome.code == 0
    records = [json.loads(line) for line in (room_folder.parent / "run" / "frames.jsonl").read_text().splitlines()]
    assert [record["name"] for record in records] == [f"{FRAMES - 1:03d}"]


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"image": "a.png"}, "predict.image is one frame and predict.data many: give one of the two"),
        ({"intrinsics": "K.txt"}, "predict.intrinsics and predict.ground_truth are used with predict.sparse= only"),
        (
            {"sparse": "points"},
            "predict.intrinsics= is missing: with predict.sparse=, .* needs the file of its camera matrix",
        ),
        ({"uncertainty": "l2"}, "there is no measure of uncertainty called 'l2': did you mean l1"),
    ],
)
def test_an_option_that_cannot_be(predict, options, sentence):
    assert re.search(sentence, predict(**options).sentence)


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (
            {"uncertainty": "parallax"},
            "predict.uncertainty=parallax compares a frame with its neighbours by their poses, and .*/room has no "
            "poses: choose a measure of single frames, flip or hidden_points or sparse_error",
        ),
        ({"export": "ply"}, "predict.export=ply fuses the frames by their poses, and .*/room has none"),
    ],
)
def test_without_poses_some_things_cannot_be(predict, room_folder, options, sentence):
    (room_folder / "poses.txt").unlink()
    assert re.match(sentence, predict(**options).sentence)


def test_a_filter_that_leaves_nothing_is_reported(predict):
    outcome = predict(uncertainty="sparse_error", least_confidence=1, export="ply")
    assert re.match(
        r".*/clouds/room\.ply would have no point: raise predict\.agreement or predict\.keep, or lower",
        outcome.sentence,
    )


def test_one_frame_with_confidence_cloud_and_filter(predict, room_folder, recorded):
    one = {
        "data": None,
        "video": None,
        "image": room_folder / "images" / "002.png",
        "sparse": room_folder / "sparse" / "002.png",
        "intrinsics": room_folder / "K.txt",
    }
    outcome = predict(**one, uncertainty="sparse_error", export="[ply,glb]", keep=0.25)
    assert (outcome.code, outcome.err) == (0, "")
    run = room_folder.parent / "run"
    depth, confidence = np.load(run / "depth.npy"), np.load(run / "confidence.npy")
    np.testing.assert_allclose(read_fraction(run / "confidence.png"), confidence, atol=1 / 65535)
    kept = confidence >= np.quantile(confidence, 0.75)
    (cloud,) = trimesh.load_scene(run / "cloud.ply").dump()
    rays = Camera(SIZE[1], SIZE[0]).rays()
    np.testing.assert_allclose(cloud.vertices, (rays * depth[..., None])[kept], atol=1e-4)
    (upright,) = trimesh.load_scene(run / "cloud.glb").dump()
    np.testing.assert_allclose(upright.vertices, cloud.vertices * [1, -1, -1], atol=1e-4)
    sentence = predict(**one, uncertainty="l1").sentence
    assert sentence.startswith(
        "predict.uncertainty=l1 compares a frame with its neighbours by their poses, and predict"
    )


def test_a_model_that_brings_its_weights_resumes_with_the_same_options_only(predict, room_folder, wall):
    outcome = predict(f"model={wall}", "model.distance=1.5", checkpoint=None, format="npy")
    assert (outcome.code, outcome.err) == (0, "")
    assert (np.load(room_folder.parent / "run" / "depth" / "room" / "000.npy") == 1.5).all()
    assert "7 of them done before" in predict(f"model={wall}", "model.distance=1.5", checkpoint=None, format="npy").out
    sentence = predict(f"model={wall}", "model.distance=2.5", checkpoint=None, format="npy").sentence
    assert "contains a run with other settings" in sentence


def test_frames_of_a_corrected_camera_are_not_taken_for_those_of_before(predict, room_folder):
    assert predict().code == 0
    run = room_folder.parent / "run"
    assert predict().code == 0
    record = json.loads((run / "run.json").read_text())
    del record["files of options"]  # as an earlier version left it
    (run / "run.json").write_text(json.dumps(record))
    assert predict().code == 0
    matrix = np.loadtxt(room_folder / "K.txt")
    np.savetxt(room_folder / "K.txt", 2 * matrix)
    assert predict().sentence == (
        f"{run} contains a run with other recorded frames, the files of predict.data have changed since it started: "
        "choose another folder with hydra.run.dir=... or delete this one."
    )


def test_a_sequence_without_poses_has_no_cloud_beside_one_that_has_them(predict, room_folder):
    videos = room_folder.parent / "videos"
    for name in ("hall", "room"):
        shutil.copytree(room_folder, videos / name)
    (videos / "hall" / "poses.txt").unlink()
    outcome = predict(data=videos, export="ply", agreement="null")
    assert outcome.code == 0, outcome.err
    assert "clouds/hall.ply is not written, since none of its 7 frames has a pose." in outcome.out + outcome.err
    assert [path.name for path in sorted((room_folder.parent / "run" / "clouds").iterdir())] == ["room.ply", "room.png"]
