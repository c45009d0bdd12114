"""Recorded video in the plain layout, without manifest and triplet list: trained on and evaluated by every model."""

import csv
import json
import math
import shutil
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image

from deux.contracts import Action, Reader
from deux.data.dataset_reader import DatasetReader
from deux.doctor import frame_checks
from deux.errors import DeuxError
from deux.geometry.camera import Camera
from deux.tasks import recorded_frames
from deux.tasks.recorded_frames import Needs, check_recorded, validation_readers
from deux.testing.box_world import Box, BoxWorld

MODELS = ("kbnet", "voiced", "scaffnet", "fusionnet")
FRAMES = 6

CAMERA = Camera(72, 66)
"""Above 64 pixels, since a pose network halves the image six times before its last convolution of 3 x 3: on maps of one
pixel the CPU's bfloat16 gradient of such a convolution is not initialised where the kernel sees padding alone."""


def record(folder: Path, split: str, sequence: str, camera: Camera, scale: float = 256.0) -> Path:
    """Write a walk through a room as one sequence of a dataset, and its frames to the split's image list."""
    world = BoxWorld(4.0, 5.0, (Box(0.5, 0.5, 1.0, 1.2, 0.8),), camera)
    world.reset(2.0, 4.0, 0.2)
    rng = np.random.default_rng(0)
    base = folder / "data" / sequence
    for kind in ("image", "sparse_depth", "ground_truth", "absolute_pose"):
        (base / kind).mkdir(parents=True)
    np.savetxt(base / "K.txt", camera.intrinsics)
    for number in range(FRAMES):
        world.step(Action.FORWARD)
        world.step(Action.LEFT)
        frame = world.observe()
        points = np.where(rng.random(frame.depth.shape) < 0.1, frame.depth, 0.0)
        Image.fromarray(frame.rgb).save(base / f"image/{number}.jpg", quality=95)
        for kind, depth in (("sparse_depth", points), ("ground_truth", frame.depth)):
            Image.fromarray(np.rint(depth * scale).astype(np.uint16)).save(base / f"{kind}/{number}.png")
        np.savetxt(base / f"absolute_pose/{number}.txt", frame.pose)
        with (folder / f"{split}_image.txt").open("a") as listed:
            listed.write(f"{folder.name}/data/{sequence}/image/{number}.jpg\n")
    return folder


@pytest.fixture(scope="module")
def video(tmp_path_factory) -> Path:
    """Three sequences, one for each split; the frames of the test split differ in size."""
    folder = tmp_path_factory.mktemp("recorded") / "video"
    record(folder, "train", "kitchen", CAMERA)
    record(folder, "validation", "office", CAMERA)
    record(folder, "test", "hall", Camera(48, 48))
    record(folder, "test", "stairs", Camera(64, 40, hfov=70.0))
    return folder


@pytest.fixture(scope="module")
def without_poses(video) -> Path:
    """The same as a camera without a tracker would leave it."""
    folder = video.parent / "without_poses"
    shutil.copytree(video, folder)
    for poses in folder.glob("data/*/absolute_pose"):
        shutil.rmtree(poses)
    return folder


def known(name: str, model_file) -> list[str]:
    """The options that spare the training of a foundation."""
    return [f"foundation.checkpoint={model_file('scaffnet')}"] if name == "fusionnet" else []


def results(folder: Path) -> dict:
    return json.loads((folder / "results.json").read_text())


@pytest.mark.parametrize("model", MODELS)
def test_recorded_poses(tiny, video, model_file, tmp_path, model):
    """Training and validation need no scenes; every frame of the test list is evaluated, whatever its size."""
    options = [f"hydra.run.dir={tmp_path}/run", f"training_data={video}", *known(model, model_file), "scenes=files"]
    outcome = tiny(tmp_path, "task=train", *options, model=model)
    assert (outcome.code, outcome.err) == (0, "")
    for split in ("train", "validation"):  # those without t-1 or t-2 have source frames after them
        assert f"6 {split} frames of {video}\n" in outcome.out
    assert not (tmp_path / "datasets").exists()
    (log,) = tmp_path.glob("run/logs/**/metrics.csv")
    with log.open() as lines:
        assert any(row.get("validation/mae") for row in csv.DictReader(lines))

    printed = outcome.out.rpartition("Trained. To evaluate it: python -m deux ")[2].split()
    assert printed == [
        "task=evaluate",
        "data=deux",
        f"evaluation.data={video}",
        f"evaluation.checkpoint={tmp_path}/run",
    ]
    outcome = tiny(tmp_path, *printed, f"hydra.run.dir={tmp_path}/tested", "scenes=files", model=model)
    assert (outcome.code, outcome.err) == (0, "")
    assert f"12 test frames of {video}" in outcome.out
    found = results(tmp_path / "tested")
    assert (found["images"], found["without_points"], found["without_truth"]) == (12, 0, 0)
    assert all(math.isfinite(value) for value in found["metrics"].values())


@pytest.mark.parametrize("model", ["kbnet", "voiced", "fusionnet"])
def test_learned_poses(tiny, without_poses, model_file, tmp_path, model):
    options = [f"training_data={without_poses}", f"hydra.run.dir={tmp_path}/run", *known(model, model_file)]
    outcome = tiny(tmp_path, "task=train", *options, model=model)
    assert outcome.sentence == (
        f"pose=simulator needs the poses of the frames, and {without_poses} has none for kitchen: use pose=learned, or "
        "frames with poses."
    )
    assert not list(tmp_path.glob("run/checkpoints/*"))
    outcome = tiny(tmp_path, "task=train", *options, "pose=learned", model=model)
    assert (outcome.code, outcome.err) == (0, "")
    assert f"4 train frames of {without_poses}; 2 others have no source frames" in outcome.out
    assert (tmp_path / "run/model.safetensors").exists()


def test_a_supervised_model_needs_no_poses(tiny, without_poses, tmp_path):
    options = [f"training_data={without_poses}", f"hydra.run.dir={tmp_path}/run"]
    outcome = tiny(tmp_path, "task=train", *options, model="scaffnet")
    assert (outcome.code, outcome.err) == (0, "")


def test_a_training_does_not_go_on_with_other_frames(tiny, video, tmp_path):
    folder = copy(video, tmp_path)
    options = ["task=train", f"training_data={folder}", f"hydra.run.dir={tmp_path}/run"]
    assert tiny(tmp_path, *options).code == 0
    assert "trained before" in tiny(tmp_path, *options).out
    matrix = np.loadtxt(folder / "data/kitchen/K.txt")
    np.savetxt(folder / "data/kitchen/K.txt", 2 * matrix)
    assert tiny(tmp_path, *options).sentence == (
        f"{tmp_path}/run contains a run with other recorded frames, the files of training_data have changed since it "
        "started: choose another folder with hydra.run.dir=... or delete this one."
    )


@dataclass(frozen=True)
class Listed:
    """What a reader keeps of its options."""

    folder: Path
    skipped: Path | None = None
    images: str = "colour"


def test_files_that_options_name_count_and_other_text_does_not(tmp_path, monkeypatch):
    """A folder of the working directory may have the name that an option gives to a part of the recorded folder."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(recorded_frames, "run_folder", lambda: tmp_path / "run")
    for name in ("frames", "colour"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "0.png").write_bytes(b"0")
    skipped = tmp_path / "skipped.txt"
    skipped.write_text("0")

    def identity() -> dict[str, str]:
        reader = Listed(tmp_path / "frames", Path("skipped.txt"))
        return recorded_frames.data_digest(reader, "training_data", SimpleNamespace(outputs=tmp_path / "outputs"))

    first = identity()
    (tmp_path / "colour/1.png").write_bytes(b"1")
    assert identity() == first
    skipped.write_text("0 1")
    assert identity() != first


def test_a_foundation_is_trained_on_generated_flats_and_that_is_logged(tiny, video, tmp_path):
    """The crop of the recorded frames is larger than the camera of those flats."""
    options = [f"training_data={video}", f"hydra.run.dir={tmp_path}/run", "training.crop=[64,72]"]
    outcome = tiny(tmp_path, "task=train", *options, model="fusionnet")
    assert (outcome.code, outcome.err) == (0, "")
    assert (
        "fusionnet is built on scaffnet, which is trained on synthetic scenes first (1 of foundation.source=apartments)"
        in outcome.out
    )
    assert [path.name.partition("-")[0] for path in tmp_path.glob("datasets/[!.]*")] == ["synthetic"]


def copy(video: Path, folder: Path) -> Path:
    shutil.copytree(video, folder / "copy")
    return folder / "copy"


def test_without_a_validation_split_there_is_no_validation_and_that_is_reported(tiny, video, tmp_path):
    folder = copy(video, tmp_path)
    (folder / "validation_image.txt").unlink()
    options = ["task=train", f"training_data={folder}", "scenes.validation=2", f"hydra.run.dir={tmp_path}/run"]
    outcome = tiny(tmp_path, *options)
    assert (outcome.code, outcome.err) == (0, "")
    assert "task=evaluate data=deux evaluation.data=" in outcome.out
    assert f"no validation: {folder} has no validation split" in outcome.out
    assert not (tmp_path / "datasets").exists()
    lines = [f"copy/data/office/image/{number}.jpg" for number in range(FRAMES)]
    with (folder / "train_image.txt").open("a") as listed:
        listed.write("\n".join(lines))
    outcome = tiny(tmp_path, *options[:-1], "data.validation=[office]", f"hydra.run.dir={tmp_path}/held-out")
    assert (outcome.code, outcome.err) == (0, "")
    assert f"6 validation frames of {folder}\n" in outcome.out
    chosen = "data=deux 'data.validation=[office]' evaluation.data="
    assert f"task=evaluate {chosen}{folder} evaluation.checkpoint=" in outcome.out
    (folder / "test_image.txt").unlink()
    outcome = tiny(tmp_path, *options[:-1], "data.validation=[office]", f"hydra.run.dir={tmp_path}/no-test")
    assert f"task=evaluate {chosen}FOLDER_WITH_TEST_FRAMES evaluation.checkpoint=" in outcome.out


@pytest.mark.parametrize("why", ["single", "blind", "partly blind"])
def test_a_validation_split_that_cannot_be_used_is_reported(tiny, video, tmp_path, why):
    folder = copy(video, tmp_path)
    if why == "single":
        (folder / "validation_image.txt").write_text("copy/data/office/image/0.jpg\ncopy/data/office/image/1.jpg")
    else:
        blind = "office" if why == "blind" else "study"
        if blind == "study":
            record(folder, "validation", blind, CAMERA)
        shutil.rmtree(folder / f"data/{blind}/ground_truth")
    options = [f"training_data={folder}", "training.sources=recent", f"hydra.run.dir={tmp_path}/run"]
    outcome = tiny(tmp_path, "task=train", *options)
    assert (outcome.code, outcome.err) == (0, "")
    sentence = {
        "single": "none of the validation frames of",
        "blind": f"{folder} has no ground truth of office",
        "partly blind": f"{folder} has no ground truth of study",
    }
    assert f"no validation: {sentence[why]}" in outcome.out


def test_depth_in_millimetres_is_noticed_and_read_by_an_option(tiny, video, model_file, tmp_path):
    folder = record(tmp_path / "mm", "test", "hall", Camera(48, 48), scale=1000.0)
    options = ["task=evaluate", f"evaluation.data={folder}", f"evaluation.checkpoint={model_file('kbnet')}"]
    outcome = tiny(tmp_path, *options, f"hydra.run.dir={tmp_path}/wrong")
    assert outcome.code == 0
    assert outcome.err.startswith(f"WARNING: the median depth of the points of {folder} is ")
    assert "with data.scale=1000 (millimetres): is the unit right?" in outcome.err
    outcome = tiny(tmp_path, *options, f"hydra.run.dir={tmp_path}/right", "data.scale=1000")
    assert (outcome.code, outcome.err) == (0, "")
    for depth in folder.glob("data/hall/sparse_depth/*.png"):
        stored = np.array(Image.open(depth))
        Image.fromarray(np.rint(stored * 0.256).astype(np.uint16)).save(depth)
    outcome = tiny(tmp_path, *options, f"hydra.run.dir={tmp_path}/truth")
    assert f"WARNING: the ground truth of {folder} is 3.91 times the sparse depth" in outcome.err
    scales = ["data.ground_truth_scale=1000", f"hydra.run.dir={tmp_path}/both"]
    assert tiny(tmp_path, *options, *scales).err == ""


def test_intrinsics_divided_by_the_images_size_are_noticed(tiny, video, tmp_path):
    folder = copy(video, tmp_path)
    matrix = np.loadtxt(folder / "data/kitchen/K.txt")
    np.savetxt(folder / "data/kitchen/K.txt", np.diag([1 / 72, 1 / 66, 1.0]) @ matrix)
    outcome = tiny(tmp_path, "task=train", f"training_data={folder}", f"hydra.run.dir={tmp_path}/run")
    assert outcome.err.startswith("WARNING: the focal lengths 0.5 and 0.54")
    assert "multiply its first row by the width 72 and its second row by the height 66." in outcome.err


def test_frames_without_points_are_counted_in_the_table(tiny, video, model_file, tmp_path):
    folder = copy(video, tmp_path)
    Image.fromarray(np.zeros((48, 48), np.uint16)).save(folder / "data/hall/sparse_depth/0.png")
    options = [f"evaluation.data={folder}", f"evaluation.checkpoint={model_file('kbnet')}"]
    outcome = tiny(tmp_path, "task=evaluate", *options, f"hydra.run.dir={tmp_path}/run")
    assert outcome.code == 0
    assert outcome.err == f"WARNING: 1 of the 8 frames of {folder} that were read has no sparse point.\n"
    assert "Errors on the 12 test frames" in outcome.out
    found = results(tmp_path / "run")
    assert found["without_points"] == 1
    assert found["baseline"]["imae"] < 500.0
    assert found["constant"]["imae"] < 500.0


def test_a_model_that_brings_its_weights_is_evaluated_without_a_checkpoint(deux, video, tmp_path, wall):
    given = [f"evaluation.data={video}", f"model={wall}", "model.distance=1.5", "trainer.accelerator=cpu"]
    outcome = deux("task=evaluate", *given, f"paths.outputs={tmp_path}", f"hydra.run.dir={tmp_path}/run")
    assert (outcome.code, outcome.err) == (0, "")
    found = results(tmp_path / "run")
    assert found["model"] == wall
    assert len(found["trained"]["weights"]) == 16


def test_errors_are_kept_for_each_recorded_sequence(deux, tmp_path, wall):
    """Their names differ in a number alone, as those of the episodes of one collected scene do."""
    for sequence in ("seq-01", "seq-02"):
        record(tmp_path / "video", "test", sequence, Camera(48, 48))
    given = [f"evaluation.data={tmp_path}/video", f"model={wall}", "model.distance=1.5", "trainer.accelerator=cpu"]
    outcome = deux("task=evaluate", *given, f"paths.outputs={tmp_path}", f"hydra.run.dir={tmp_path}/run")
    assert (outcome.code, outcome.err) == (0, "")
    assert [(scene["scene"], scene["frames"]) for scene in results(tmp_path / "run")["scenes"]] == [
        ("seq-01", FRAMES),
        ("seq-02", FRAMES),
    ]


def test_a_reader_that_finds_nothing_is_reported_with_folder_and_split(tmp_path, capsys):
    class Blind(Reader):
        folder = tmp_path
        image = intrinsics = sparse_depth = None

        def triplets(self, split, offsets):
            return []

    told = f"split of {tmp_path} has no frames for the Blind: give a folder with such frames, or set the options"
    with pytest.raises(DeuxError, match=f"^the train {told}"):
        check_recorded(Blind(), "train", (-1, -2), None, Needs())
    assert validation_readers(Blind(), (-1, -2), Needs()) == []
    assert f"no validation: the validation {told}" in capsys.readouterr().out


def test_a_damaged_validation_frame_is_no_lack_of_validation_frames(tmp_path, capsys):
    folder = record(tmp_path / "video", "validation", "office", CAMERA)
    for file in (folder / "data/office/sparse_depth/3.png", folder / "data/office/image/3.jpg"):
        file.write_bytes(file.read_bytes()[:100])
    with pytest.raises(DeuxError, match=r"image/3\.jpg cannot be read as an image"):
        validation_readers(DatasetReader(folder), (-1, -2), Needs(sources=True), "baseline")
    assert "no validation" not in capsys.readouterr().out


def test_a_damaged_list_of_validation_frames_is_no_lack_of_them(tmp_path, capsys):
    folder = record(tmp_path / "video", "validation", "office", CAMERA)
    (folder / "validation_image.txt").write_bytes(b"\xff\xfe" * 40)
    reader = DatasetReader(folder)
    for use in (lambda: validation_readers(reader, (-1, -2), Needs()), lambda: frame_checks.check_frames(reader)):
        with pytest.raises(DeuxError, match=r"validation_image\.txt is not a list of frames"):
            use()
    assert "no validation" not in capsys.readouterr().out


def test_training_frames_without_any_point_are_refused(video, tmp_path):
    folder = copy(video, tmp_path)
    for file in folder.glob("data/*/sparse_depth/*.png"):
        Image.fromarray(np.zeros((CAMERA.height, CAMERA.width), np.uint16)).save(file)
    with pytest.raises(DeuxError, match=f"^none of the 6 frames of {folder} that were read has a sparse point"):
        check_recorded(DatasetReader(folder), "train", (-1, -2), None, Needs())


def test_ground_truth_without_any_value_is_no_validation(video, tmp_path, capsys):
    folder = copy(video, tmp_path)
    assert validation_readers(DatasetReader(folder), (-1, -2), Needs()) == [DatasetReader(folder)]
    for file in folder.glob("data/office/ground_truth/*.png"):
        Image.fromarray(np.zeros((CAMERA.height, CAMERA.width), np.uint16)).save(file)
    assert validation_readers(DatasetReader(folder), (-1, -2), Needs()) == []
    told = f"no validation: the ground truth of all 6 validation frames of {folder} that were read is 0"
    assert told in capsys.readouterr().out
