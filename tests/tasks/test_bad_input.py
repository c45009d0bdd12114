"""Bad input of every kind ends in one sentence on stderr and exit code 1, and leaves nothing that is taken as whole."""

import csv
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import safetensors.torch
import torch
import trimesh

import deux as package
from deux.deployment.model_files import load_model, save_model
from deux.errors import DeuxError

MISTAKES = {
    # names
    "task=collct": "there is no task called 'collct': did you mean collect?",
    "model=kbnt": "there is no depth model called 'kbnt': did you mean kbnet?",
    "explore=rndom": "there is no explorer called 'rndom': did you mean random?",
    "seed_model.explore=rndom": "there is no explorer called 'rndom': did you mean random?",
    "compare.explorers=[rndom]": "there is no explorer called 'rndom': did you mean random?",
    "compare.baseline=rndom": "there is no explorer called 'rndom': did you mean random?",
    "objective.color_consistncy=1": "there is no loss term called 'color_consistncy': did you mean color_consistency",
    "scenes=apartmnts": "there is no source of scenes called 'apartmnts': did you mean apartments?",
    "evaluation.data=void": "evaluation.data=void has no effect with task=experiment, which evaluates its own model",
    "training.crop=[100,9]": "training.crop=[100,9] is 9 x 100 pixels (width x height), larger than the ",
    "experiment=debg": "there is no experiment called 'debg': did you mean debug?",
    "simulator.renderer=embre": "simulator.renderer cannot be 'embre': did you mean embree?",
    "pose=lerned": "pose=lerned is no source of poses: did you mean learned?",
    "collect.uncertainty=l3": "there is no measure of uncertainty called 'l3': did you mean l1?",
    # keys
    "trainig.steps=3": "there is no option trainig: did you mean training",
    "collect.step=3": "there is no option collect.step: did you mean steps?",
    "camera.hfvo=90": "camera.hfvo is not an option of Camera: did you mean hfov?",
    "training.stepz=3": "training.stepz is not an option of TrainingSettings: did you mean steps?",
    "trainer.acclerator=cpu": "trainer.acclerator is not an option of Trainer: did you mean accelerator?",
    "model.min_dept=1": "model.min_dept is not an option of KBNet: did you mean min_depth",
    "explore.steps=3": "explore.steps is not an option of RandomExplorer: ",
    "scenes.trains=3": "scenes.trains is not an option of Apartments: did you mean train?",
    "simulator.rendrer=embree": "simulator.rendrer is not an option of MeshSimulator: did you mean renderer?",
    "objective.sparse_depth.weigth=2": "objective.sparse_depth.weigth is not an option of",
    # types
    "camera.width=abc": "camera.width must be a whole number, but is 'abc'.",
    "camera.width=64.5": "camera.width must be a whole number, but is 64.5.",
    "collect.steps=abc": "collect.steps must be a whole number, but is 'abc'.",
    "seed=abc": "seed is 'abc': it must be a whole number from 0 to 4294967295.",
    "training.offsets=[-1,0]": "training.offsets is [-1, 0]: it lists the source frames as distances from the target",
    "training.crop=64": "training.crop must be a list of 2 values (a whole number, a whole number) or null, but is 64.",
    "verification.min_points=few": "verification.min_points must be a number, but is 'few'.",
    "objective.sparse_depth=heavy": "objective.sparse_depth has the weight 'heavy': a weight is a number of 0 or more",
    "scenes.train=many": "scenes.train must be a whole number or a list (each a whole number), but is 'many'.",
    "trainer.accelerator=gpuu": "lightning.Trainer refuses the settings under trainer: You selected an invalid acc",
    "trainer.devices=many": "lightning.Trainer refuses the settings under trainer: `devices` selected with",
    # ranges
    "camera.width=0": "camera.width is 0: it must be at least 1.",
    "camera.hfov=200": "camera.hfov is 200.0: it must be above 0 and below 180.",
    "camera.max_depth=0.05": "camera.max_depth is 0.05: it must be above 0.1.",
    "robot.radius=-1": "robot.radius is -1.0: it must be at least 0.",
    "robot.turn_angle=nan": "robot.turn_angle is nan: it must be above 0 and below 180.",
    "collect.steps=0": "collect.steps is 0: it must be at least 3.",
    "collect.uncertainty_options.nothing=1": "collect.uncertainty_options.nothing is not an option of SparseError",
    "collect.processes=0": "collect.processes is 0: it must be at least 1.",
    "collect.executor=rai": "collect.executor cannot be 'rai': did you mean ray?",
    "collect.executor_options.worker=3": "collect.executor_options.worker is not an option of LocalExecutor",
    "sampling.density=2": "sampling.density is 2.0: it must be at least 1e-06 and at most 1.",
    "seed_model.explore=viewpoints": "seed_model.explore=viewpoints stands for free viewpoints, which no robot can "
    "collect: choose another explorer.",
    "seed_model.steps=-1": "seed_model.steps is -1: it must be at least 1.",
    "training.steps=-3": "training.steps is -3: it must be at least 1.",
    "training.batch_size=0": "training.batch_size is 0: it must be at least 1.",
    "training.validations=0": "training.validations is 0: it must be at least 1.",
    "evaluation.viewpoints=0": "evaluation.viewpoints is 0: it must be at least 1.",
    "compare.steps=1": "compare.steps is 1: it must be at least 2.",
    "compare.figure_scene=20": "compare.figure_scene is 20, but there is 1 scene, counted from 0.",
    "seed=-1": "seed is -1: it must be a whole number from 0 to 4294967295.",
    "objective.structural_consistency.window_size=4": "objective.structural_consistency.window_size is 4: it must be",
    "objective.sparse_depth=-1": "objective.sparse_depth has the weight -1: a weight is a number of 0 or more",
    "scenes.test=0": "scenes.test names no scene: at least one is needed.",
    "model.min_depth=-1": "min_depth=-1.0 and max_depth=10.0 must satisfy 0 < min_depth < max_depth",
    "compare.explorers=[]": "compare.explorers is empty: list some, or set it to null for all installed explorers.",
    "compare.explorers=random": "compare.explorers must be a list",
    # what another option asks for
    "task=evaluate": "a trained model is needed: set evaluation.checkpoint= to a run folder, a model file, the ",
}


@pytest.mark.parametrize("override", MISTAKES)
def test_a_mistake_in_the_configuration_ends_before_any_work(tiny, tmp_path, override):
    group = [] if override.startswith("explore=") else ["explore=random"]
    task = {"compare": ["task=compare_explorers"]}.get(override.partition(".")[0], [])
    guided = ["explore=deux"] if override.startswith(("seed_model.", "collect.uncertainty")) else []
    sentence = tiny(tmp_path, *group, *guided, *task, override).sentence
    assert sentence.startswith(MISTAKES[override])
    assert {path.name for path in tmp_path.rglob("*") if path.is_file()} <= {
        "deux.log",
        "config.yaml",
        "hydra.yaml",
        "overrides.yaml",
    }


def test_an_objective_needs_a_term(tiny, tmp_path):
    terms = ("color_consistency", "structural_consistency", "local_smoothness", "sparse_depth")
    outcome = tiny(tmp_path, "explore=random", *(f"objective.{term}=null" for term in terms))
    assert outcome.sentence == "the objective has no terms: give at least one loss term a weight above 0."


def test_outputs_need_a_folder(tiny, tmp_path):
    (tmp_path / "file").touch()
    assert tiny(tmp_path / "file", "explore=random").sentence.startswith(f"{tmp_path}/file")


# -------------------------------------------------------------------------------------------------------- scenes


def plane(folder: Path, name: str, tilt: float) -> Path:
    """A square of 4 m x 4 m in four colours, tilted about the x axis, as a .glb."""
    corners = [[-2.0, 0.0, -2.0], [2.0, 0.0, -2.0], [2.0, 0.0, 2.0], [-2.0, 0.0, 2.0]]
    mesh = trimesh.Trimesh(corners, [[0, 2, 1], [0, 3, 2]], vertex_colors=np.eye(4, 3, dtype=np.uint8) * 255)
    mesh.apply_transform(trimesh.transformations.rotation_matrix(tilt, (1, 0, 0)))
    path = folder / f"{name}.glb"
    trimesh.Scene(mesh).export(path)
    return path


def scene_file(kind: str, room, folder: Path) -> Path:
    """A scene file with the given fault."""
    path = folder / f"{kind}.glb"
    if kind == "walls":
        return room("walls", "walls")
    if kind == "full":
        trimesh.Scene(trimesh.creation.box((1.2, 0.1, 1.2))).export(path)
    elif kind == "tilted":
        return plane(folder, kind, tilt=np.pi / 3)
    elif kind == "bare":
        return plane(folder, kind, tilt=0.0)
    elif kind == "points":
        trimesh.Scene(trimesh.PointCloud(np.eye(3))).export(path)
    elif kind == "text":
        path.write_text("This is no scene.\n" * 10)
    elif kind == "truncated":
        content = room("whole", "floor", "walls").read_bytes()
        path.write_bytes(content[: len(content) // 2])
    elif kind == "ply":
        path = folder / "header.ply"
        path.write_text("ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\n")
    elif kind == "suffix":
        path = folder / "scene.txt"
    return path


@pytest.mark.parametrize(
    ("kind", "sentence"),
    [
        (
            "walls",
            "walls.glb: there is no floor to stand on: no level surface of 1 m2 has 1 m of empty space above it.",
        ),
        ("tilted", "tilted.glb: there is no floor to stand on: no level surface of 1 m2 has 1 m of empty space above"),
        ("bare", "has no frame that passes verification ("),
        ("points", "points.glb contains no triangles: a scene needs surfaces."),
        ("text", "text.glb is not a .glb file: it does not begin like one."),
        ("truncated", "truncated.glb is truncated to "),
        ("ply", "header.ply is damaged or not a .ply file: "),
        ("suffix", "scene.txt is not a scene file: its name must end in one of .glb, .gltf, .obj, .ply."),
        ("nowhere", "there is no scene file "),
    ],
)
def test_a_scene_that_cannot_be_explored(tiny, room, tmp_path, kind, sentence):
    path = scene_file(kind, room, tmp_path)
    options = ["task=collect", "explore=random", "scenes=files", f"scenes.train=[{path}]"]
    assert sentence in tiny(tmp_path / "outputs", *options).sentence
    assert not list(tmp_path.glob("outputs/datasets/[!.]*"))


# ------------------------------------------------------------------------------------------------------ datasets


def truncate(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:100])


def empty(path: Path) -> None:
    path.write_bytes(b"")


def make_singular(path: Path) -> None:
    path.write_text("0 0 0\n0 0 0\n0 0 1\n")


DAMAGES = {
    "truncated image": ("image/*.png", truncate, "is truncated (100 bytes)."),
    "missing image": ("image/*.png", Path.unlink, "is missing."),
    "missing points": ("sparse_depth/*.png", Path.unlink, "is missing."),
    "empty pose": ("absolute_pose/*.txt", empty, "is not a pose: 3 or 4 rows of 4 finite numbers are expected."),
    "singular intrinsics": ("K.txt", make_singular, "is not the matrix of a pinhole camera"),
    "missing intrinsics": ("K.txt", Path.unlink, "is missing."),
}


@pytest.mark.parametrize(
    ("damage", "task"), [(d, t) for d in DAMAGES for t in ("train", "evaluate") if (d, t) != ("empty pose", "evaluate")]
)
def test_a_damaged_dataset_is_named_to_the_file(tiny, tested, tmp_path, damage, task):
    pattern, spoil, sentence = DAMAGES[damage]
    split = {"train": "random", "evaluate": "test"}[task]
    dataset = tmp_path / "dataset"
    shutil.copytree(next(tested.glob(f"datasets/{split}-*")), dataset)
    file = max(dataset.glob(f"data/*/{pattern}"))
    spoil(file)
    assert use(tiny, tested, tmp_path, task, dataset).startswith(f"{file} {sentence}")


def test_a_collected_dataset_without_its_manifest_is_collected_again_once_it_is_deleted(tiny, collected, tmp_path):
    (dataset,) = collected.glob("datasets/random-*")
    partly_copied = tmp_path / "datasets" / dataset.name
    shutil.copytree(dataset, partly_copied, ignore=shutil.ignore_patterns("manifest.json"))
    command = ["task=collect", "explore=random", f"hydra.run.dir={tmp_path}/run"]
    assert tiny(tmp_path, *command).sentence == (
        f"{partly_copied} holds no readable manifest.json, so it is no dataset that deux collected: "
        f"{partly_copied}/manifest.json is missing. Delete this folder; the same command then collects it again."
    )
    shutil.rmtree(partly_copied)
    assert tiny(tmp_path, *command).code == 0


def test_a_broken_pose_spoils_no_evaluation(tiny, tested, tmp_path):
    dataset = tmp_path / "dataset"
    shutil.copytree(next(tested.glob("datasets/test-*")), dataset)
    for file in dataset.glob("data/*/absolute_pose/*.txt"):
        empty(file)
    given = [f"evaluation.data={dataset}", f"evaluation.checkpoint={tested}/trained", f"hydra.run.dir={tmp_path}/run"]
    outcome = tiny(tmp_path / "outputs", "task=evaluate", *given)
    assert (outcome.code, outcome.err) == (0, "")


def test_supervision_alone_reads_the_ground_truth(tiny, tested, tmp_path):
    for task, split in (("train", "random"), ("evaluate", "test")):
        shutil.copytree(next(tested.glob(f"datasets/{split}-*")), tmp_path / task)
        shutil.rmtree(next(tmp_path.glob(f"{task}/data/*")) / "ground_truth")
    outcome = tiny(tmp_path, "task=train", f"training_data={tmp_path}/train")
    assert (outcome.code, outcome.err) == (0, "")
    assert "has no ground truth of" in use(tiny, tested, tmp_path, "evaluate", tmp_path / "evaluate")


@pytest.mark.parametrize("task", ["train", "evaluate"])
def test_a_folder_that_is_no_dataset(tiny, tested, tmp_path, task):
    assert use(tiny, tested, tmp_path, task, tmp_path).startswith(f"{tmp_path} is no dataset: ")
    (tmp_path / "data").mkdir()
    sentence = use(tiny, tested, tmp_path, task, tmp_path)
    assert f"{tmp_path} has no {task.replace('evaluate', 'test')} split" in sentence
    assert "it has no list files at all" in sentence


def use(tiny, tested: Path, folder: Path, task: str, dataset: Path) -> str:
    """The sentence with which a task refuses a dataset; it leaves no results behind."""
    given = {
        "train": [f"training_data={dataset}"],
        "evaluate": [f"evaluation.data={dataset}", f"evaluation.checkpoint={tested}/trained"],
    }
    sentence = tiny(folder / "outputs", f"task={task}", *given[task]).sentence
    assert not list(folder.glob("outputs/**/model.safetensors"))
    assert not list(folder.glob("outputs/**/results.json"))
    return sentence


# --------------------------------------------------------------------------------------------------- checkpoints


def checkpoint_file(kind: str, trained: Path, folder: Path) -> Path:
    """A file that is not the checkpoint of a KBNet."""
    model = trained / "trained" / "model.safetensors"
    path = folder / f"{kind}.safetensors"
    weights = safetensors.torch.load_file(model)
    if kind == "damaged":
        path.write_bytes(model.read_bytes()[:5000])
    elif kind == "foreign":
        safetensors.torch.save_file(weights, path)
    elif kind in ("other", "lacking"):
        name = {"other": "kbnit", "lacking": "kbnet"}[kind]
        settings = load_settings(model)
        del weights["decoder.output0.conv.weight" if "decoder.output0.conv.weight" in weights else min(weights)]
        said = json.dumps({"name": name, "settings": settings, "version": "0.0.1"})
        safetensors.torch.save_file(weights, path, {"deux": said})
    elif kind == "lightning":
        path = folder / "lightning.ckpt"
        shutil.copy(next((trained / "trained" / "checkpoints").glob("*.ckpt")), path)
    elif kind == "layout":
        path = folder / "layout.pth"
        torch.save({"state_dict": weights}, path)
    elif kind == "code":
        path = folder / "code.pth"
        torch.save(torch.nn.Linear(2, 2), path)
    elif kind == "folder":
        path = folder
    return path


def load_settings(model: Path) -> dict:
    with safetensors.safe_open(model, framework="pt") as stream:
        return json.loads(stream.metadata()["deux"])["settings"]


@pytest.mark.parametrize("option", ["seed_model.checkpoint", "evaluation.checkpoint"])
@pytest.mark.parametrize(
    ("kind", "sentence"),
    [
        ("damaged", "damaged.safetensors cannot be read as safetensors, it is damaged or something else: "),
        ("foreign", "foreign.safetensors has no configuration of a model, so it was not written by deux:"),
        (
            "other",
            "has a 'kbnit' that cannot be created here: there is no depth model called 'kbnit': did you mean kbnet",
        ),
        ("lacking", "does not fit the kbnet that is installed: it lacks 1 tensor ("),
        ("lightning", ".ckpt is for resuming a training: give the model.safetensors of a run folder, or the folder."),
        ("layout", "layout.pth is not a published checkpoint of kbnet: it lacks "),
        (
            "code",
            "code.pth cannot be read as a checkpoint of tensors: it is damaged, not a checkpoint, or contains code",
        ),
        ("folder", "there is no model "),
        ("missing", "there is no model "),
    ],
)
def test_a_checkpoint_that_is_none(tiny, trained, tmp_path, option, kind, sentence):
    path = checkpoint_file(kind, trained, tmp_path)
    task = {"seed_model.checkpoint": "collect", "evaluation.checkpoint": "evaluate"}[option]
    outcome = tiny(tmp_path / "outputs", "explore=deux", f"task={task}", f"{option}={path}")
    assert sentence in outcome.sentence
    assert not list(tmp_path.glob("outputs/datasets/[!.]*"))


@pytest.mark.parametrize("diagonal", [(0.0, 50.0, 1.0), (50.0, 50.0, 0.0), (50.0, -50.0, 1.0)])
def test_a_model_refuses_singular_intrinsics(trained, diagonal):
    model = package.load(trained / "trained")
    image, points = torch.rand(1, 3, 48, 48), torch.ones(1, 1, 48, 48)
    with pytest.raises(
        DeuxError, match=r"^intrinsics\[0\] = .* is singular or no camera matrix: it is \[\[fx, s, cx\]"
    ):
        model.predict(image, points, torch.diag(torch.tensor(diagonal))[None])


# -------------------------------------------------------------------------------------- full disks and interruptions


@pytest.fixture
def small_disk(tmp_path):
    """A disk in memory: resize(kilobytes) gives its folder. Its files must be closed when the test ends."""
    folder = tmp_path / "disk"
    folder.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=300k", "none", str(folder)]
    if os.geteuid() or subprocess.run(mount, capture_output=True, check=False).returncode:
        pytest.skip("only root can mount a small disk, and not in every container")

    def resize(kilobytes: int) -> Path:
        subprocess.run(["mount", "-o", f"remount,size={kilobytes}k", str(folder)], check=True)
        return folder

    yield resize
    subprocess.run(["umount", "--lazy", str(folder)], check=True)


def unfinished(folder: Path) -> list[Path]:
    """Files under a temporary name."""
    return [path for path in folder.rglob(".*") if path.is_file()]


def test_a_full_disk_is_reported_and_the_same_command_goes_on_when_there_is_room(tiny, small_disk):
    disk = small_disk(60)
    command = ("task=train", "explore=random", f"hydra.run.dir={disk}/run")
    sentence = tiny(disk, *command).sentence
    assert sentence.startswith(f"The disk is full: {disk}/datasets/.random-")
    assert " kB are free; free some space and start again, finished files are kept." in sentence
    collected = {path: path.stat().st_mtime_ns for path in disk.glob("datasets/.*.partial/data/*/absolute_pose/0*.txt")}
    assert 0 < len(collected) < 8
    assert unfinished(disk) == []

    small_disk(300)
    sentence = tiny(disk, *command).sentence
    assert sentence.startswith(f"The disk is full: {disk}/run/checkpoints/epoch=0-step=1.ckpt (")
    (dataset,) = disk.glob("datasets/random-*")
    for path, written in collected.items():
        assert (dataset / path.relative_to(path.parents[3])).stat().st_mtime_ns == written
    assert unfinished(disk) == []
    assert not list((disk / "run").glob("**/*.ckpt"))
    assert not (disk / "run" / "model.safetensors").exists()

    small_disk(3000)
    outcome = tiny(disk, *command)
    assert (outcome.code, outcome.err) == (0, "")
    assert (disk / "run" / "model.safetensors").exists()


def test_a_disk_that_is_full_to_the_last_byte(tiny, collected, small_disk):
    """Then not even Hydra's and the loggers' own files can be written."""
    disk = small_disk(12)
    dataset = next(collected.glob("datasets/random-*"))
    for kilobytes in (4, 12, 16, 20, 24):
        small_disk(kilobytes)
        outcome = tiny(disk, "task=train", f"training_data={dataset}", f"hydra.run.dir={disk}/run")
        assert "o space left" in outcome.sentence or "The disk is full" in outcome.sentence
    small_disk(3000)
    assert tiny(disk, "task=train", f"training_data={dataset}", f"hydra.run.dir={disk}/run").code == 0


def test_a_model_that_cannot_be_saved_leaves_the_one_before(trained, small_disk):
    model, settings = package.load(trained / "trained"), load_settings(trained / "trained" / "model.safetensors")
    file = small_disk(100) / "model.safetensors"
    save_model(file, model, "kbnet", settings)
    before = file.read_bytes()
    with torch.no_grad():
        next(model.parameters()).zero_()
    with pytest.raises(
        DeuxError, match=r"^The disk is full: .*/model\.safetensors \(\d+ kB\) could not be written, \d+ "
    ):
        save_model(file, model, "kbnet", settings)
    assert file.read_bytes() == before
    assert unfinished(file.parent) == []
    small_disk(300)
    save_model(file, model, "kbnet", settings)
    assert next(load_model(file).parameters()).count_nonzero() == 0


def interrupt(command: list[str], reached, patience: float = 120.0, how=signal.SIGINT) -> tuple[int, str]:
    """Press Ctrl-C, which goes to all processes of the command, as soon as `reached()`; its exit code and stderr.

    SIGTERM in its place is sent to the command alone, as batch systems and containers do.
    """
    process = subprocess.Popen(
        command,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        env={**os.environ, "OMP_NUM_THREADS": "1"},
    )
    deadline = time.monotonic() + patience
    while not reached():
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < deadline, "the run never came to where it was to be interrupted"
        time.sleep(0.002)
    os.killpg(process.pid, how) if how == signal.SIGINT else process.send_signal(how)
    _, err = process.communicate(timeout=patience)
    return process.returncode, err


INTERRUPTED = (130, "deux: interrupted; the same command goes on from here.\n")
TERMINATED = (143, "deux: ended by SIGTERM; the same command goes on from here.\n")


def test_an_interrupted_training_goes_on(tiny, tiny_arguments, collected, tmp_path):
    dataset, run = next(collected.glob("datasets/random-*")), tmp_path / "run"
    options = ["task=train", f"training_data={dataset}", "training.steps=50", f"hydra.run.dir={run}"]
    command = [sys.executable, "-m", "deux", *tiny_arguments(tmp_path, *options)]
    ended = interrupt(command, lambda: list(run.glob("checkpoints/*.ckpt")))
    assert ended == INTERRUPTED, ended[1]  # the whole stack trace, if there is one
    (checkpoint,) = run.glob("checkpoints/*.ckpt")
    done = torch.load(checkpoint, weights_only=True)["global_step"]
    assert 0 < done < 50
    assert not (run / "model.safetensors").exists()

    outcome = tiny(tmp_path, *options)
    assert (outcome.code, outcome.err) == (0, "")
    with (run / "logs" / "version_1" / "metrics.csv").open() as log:
        steps = [int(row["step"]) for row in csv.DictReader(log)]
    assert done <= min(steps) < done + 5  # every fifth step is logged
    assert max(steps) == 49


@pytest.mark.slow
def test_interrupted_collectors_are_silent(tiny_arguments, tmp_path):
    options = ["task=collect", "explore=random", "scenes.train=2", "collect.steps=5000", "collect.processes=2"]
    command = [sys.executable, "-m", "deux", *tiny_arguments(tmp_path, *options)]
    poses = "datasets/.random-*.partial/data/*/absolute_pose/0*.txt"
    assert interrupt(command, lambda: len(list(tmp_path.glob(poses))) > 5) == INTERRUPTED


@pytest.mark.slow
def test_a_training_ended_by_sigterm_goes_on(tiny, tiny_arguments, collected, tmp_path):
    dataset, run = next(collected.glob("datasets/random-*")), tmp_path / "run"
    options = ["task=train", f"training_data={dataset}", "training.steps=100", f"hydra.run.dir={run}"]
    command = [sys.executable, "-m", "deux", *tiny_arguments(tmp_path, *options)]
    ended = interrupt(command, lambda: list(run.glob("checkpoints/*.ckpt")), 250.0, signal.SIGTERM)
    assert ended == TERMINATED
    assert not (run / "model.safetensors").exists()
    outcome = tiny(tmp_path, *options)
    assert (outcome.code, outcome.err) == (0, "")


@pytest.mark.slow
def test_collectors_end_with_a_command_that_is_ended_by_sigterm(tiny_arguments, tmp_path):
    options = ["task=collect", "explore=random", "scenes.train=2", "collect.steps=5000", "collect.processes=2"]
    command = [sys.executable, "-m", "deux", *tiny_arguments(tmp_path, *options)]
    poses = "datasets/.random-*.partial/data/*/absolute_pose/0*.txt"
    ended = interrupt(command, lambda: len(list(tmp_path.glob(poses))) > 5, 250.0, signal.SIGTERM)
    assert ended == TERMINATED
    written = len(list(tmp_path.glob(poses)))
    time.sleep(2)
    assert len(list(tmp_path.glob(poses))) == written


@pytest.mark.slow
def test_the_episode_of_a_killed_collector_is_done_again(tiny_arguments, tmp_path):
    """A child that dies of SIGKILL, as by the kernel's out-of-memory killer: one sentence, and no frame is lost."""
    options = ["task=collect", "explore=random", "scenes.train=2", "collect.steps=60", "collect.processes=2"]
    command = [sys.executable, "-m", "deux", *tiny_arguments(tmp_path / "killed", *options)]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    poses = "datasets/.random-*.partial/data/*/absolute_pose/0*.txt"
    while len(list((tmp_path / "killed").glob(poses))) < 10:
        assert process.poll() is None, process.communicate()
        time.sleep(0.01)
    children = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()
    workers = [int(child) for child in children if b"spawn_main" in Path(f"/proc/{child}/cmdline").read_bytes()]
    os.kill(workers[0], signal.SIGKILL)
    _, err = process.communicate(timeout=250)
    assert process.returncode == 1
    assert err.count("\n") == 1
    assert "was killed by SIGKILL, as the system does when memory runs out" in err

    for folder in ("killed", "whole"):
        again = subprocess.run(
            [sys.executable, "-m", "deux", *tiny_arguments(tmp_path / folder, *options)],
            capture_output=True,
            check=True,
        )
        assert again.stderr == b""
    killed, whole = (
        {path.relative_to(tmp_path / folder): path.read_bytes() for path in (tmp_path / folder).rglob("data/*/*/*.*")}
        for folder in ("killed", "whole")
    )
    assert killed == whole
    assert len(whole) > 100


def test_a_run_folder_of_other_settings(tiny, trained):
    run = f"hydra.run.dir={trained}/trained"
    sentence = tiny(trained, "task=train", "explore=random", "training.steps=9", run).sentence
    assert sentence.startswith(
        f"{trained}/trained contains a run with other settings (training.steps: 2 there, 9 here):"
    )


def test_one_failing_job_does_not_stop_a_sweep(tiny, tmp_path):
    outcome = tiny(tmp_path, "task=collect", "explore=random", "robot.radius=3,0.1", "-m")
    assert outcome.code == 1
    first, *_, last = outcome.err.splitlines()
    assert first.startswith("deux: [")
    assert "robot.radius=3" in first
    assert "] apartment_000000: there is no floor to stand on" in first
    assert last == "deux: 1 of the sweep's 2 jobs failed, as reported above."
    assert "Traceback" not in outcome.err
    assert len(list(tmp_path.glob("datasets/random-*/manifest.json"))) == 1
