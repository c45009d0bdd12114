"""What each task leaves behind, in runs of the smallest size."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
import torch

import deux as package
from deux.collection.pipeline import read_manifest
from deux.deployment.model_files import save_model
from deux.errors import DeuxError
from deux.figures import depth_figures
from deux.figures.depth_figures import draw_depth_panels
from deux.io.calibration import read_intrinsics, read_pose
from deux.io.images import read_depth, read_image
from deux.io.layout import sequences
from deux.simulator.egl_context import EGLContext


def only(folder: Path, pattern: str) -> Path:
    (path,) = folder.glob(pattern)
    return path


def results(folder: Path) -> dict:
    return json.loads((folder / "results.json").read_text())


def moments(folder: Path) -> dict[Path, int]:
    """When each file of a folder was last written."""
    return {path: path.stat().st_mtime_ns for path in folder.rglob("*") if path.is_file()}


def test_collecting_leaves_a_dataset_and_the_robots_path(collected):
    dataset = only(collected, "datasets/random-*")
    manifest = read_manifest(dataset)
    assert (manifest["frames"], manifest["triplets"]) == (8, 6)
    assert len((dataset / "train_image.txt").read_text().splitlines()) == 6
    assert only(collected, "collected/figures/*").name == "trajectory_apartment_000000-00.png"


@pytest.mark.parametrize("choice", ["baseline", "recent"])
def test_a_scorecard_judges_the_source_frames_of_the_training(tiny, collected, choice):
    run = collected / f"judged-{choice}"
    arguments = ("task=collect", "explore=random", f"training.sources={choice}", f"hydra.run.dir={run}")
    outcome = tiny(collected, *arguments)
    assert (outcome.code, outcome.err) == (0, "")
    assert f"sources: {choice}" in outcome.out
    card = json.loads((run / "scorecard.json").read_text())
    manifest = read_manifest(only(collected, "datasets/random-*"))
    assert card["sources"] == choice
    assert card["frames"] == (manifest if choice == "recent" else manifest["baseline"])["triplets"]
    assert (card["actions"], card["depth_distance"]) == (8, None)


def test_training_on_a_given_dataset_collects_nothing(tiny, collected, tmp_path):
    dataset = only(collected, "datasets/random-*")
    outcome = tiny(tmp_path, "task=train", f"training_data={dataset}", f"hydra.run.dir={tmp_path}/run")
    assert (outcome.code, outcome.err) == (0, "")
    assert f"evaluation.checkpoint={tmp_path}/run" in outcome.out
    assert not (tmp_path / "datasets").exists()
    assert package.load(tmp_path / "run").max_depth == 10.0


@pytest.fixture(scope="module")
def without_poses(tested, tmp_path_factory) -> Path:
    """Copies of the recorded frames, `train` and `test`, as a camera without a tracker would leave them."""
    folder = tmp_path_factory.mktemp("recorded")
    for split, source in (("train", "random"), ("test", "test")):
        shutil.copytree(only(tested, f"datasets/{source}-*"), folder / split)
        for poses in (folder / split).glob("data/*/absolute_pose"):
            shutil.rmtree(poses)
    return folder


def test_frames_without_poses_train_with_learned_ones(tiny, without_poses, tmp_path):
    options = ["task=train", f"training_data={without_poses}/train", f"hydra.run.dir={tmp_path}/run"]
    sentence = tiny(tmp_path, *options).sentence
    assert "pose=learned" in sentence
    outcome = tiny(tmp_path, *options, "pose=learned")
    assert (outcome.code, outcome.err) == (0, "")
    assert (tmp_path / "run" / "model.safetensors").exists()


def test_frames_without_poses_are_evaluated(tiny, tested, without_poses, tmp_path):
    folders = [f"evaluation.checkpoint={tested}/trained", f"hydra.run.dir={tmp_path}/run"]
    outcome = tiny(tmp_path, "task=evaluate", f"evaluation.data={without_poses}/test", *folders)
    assert (outcome.code, outcome.err) == (0, "")
    assert results(tmp_path / "run")["metrics"] == pytest.approx(results(tested / "tested")["metrics"], rel=1e-6)
    assert (tmp_path / "run" / "figures" / "test_frames.png").stat().st_size > 1000


@pytest.mark.usefixtures("wall")
def test_a_model_without_weights_is_evaluated(tiny, tested, tmp_path):
    data = only(tested, "datasets/test-*")
    folders = [f"evaluation.data={data}", f"hydra.run.dir={tmp_path}/run"]
    outcome = tiny(tmp_path, "task=evaluate", *folders, model="wall")
    assert (outcome.code, outcome.err) == (0, "")
    assert results(tmp_path / "run")["baseline"] == results(tested / "tested")["baseline"]


def test_recorded_frames_are_not_validated_on_generated_flats(tiny, collected, tmp_path):
    dataset = only(collected, "datasets/random-*")
    options = [f"training_data={dataset}", "scenes.validation=2", f"hydra.run.dir={tmp_path}/run"]
    assert tiny(tmp_path, "task=train", *options).code == 0
    assert not (tmp_path / "datasets").exists()


def test_a_model_is_judged_alike_wherever_its_test_frames_come_from(tiny, tested, tmp_path):
    known = results(tested / "tested")
    assert all(value > 0 for value in known["metrics"].values())
    assert (known["explore"], known["frames"]) == (None, None)
    dataset = only(tested, "datasets/test-*")
    folders = [f"evaluation.checkpoint={tested}/trained", f"hydra.run.dir={tmp_path}/run"]
    outcome = tiny(tmp_path, "task=evaluate", f"evaluation.data={dataset}", *folders)
    assert (outcome.code, outcome.err) == (0, "")
    for predicted in ("metrics", "corrected", "baseline", "constant"):
        assert results(tmp_path / "run")[predicted] == pytest.approx(known[predicted], rel=1e-6)
    assert not (tmp_path / "datasets").exists()


def test_a_published_checkpoint_is_evaluated_as_it_is(tiny, tested, tmp_path):
    model = package.load(tested / "trained")
    published = {group: module.state_dict() for group, module in model.published_modules().items()}
    torch.save(published, tmp_path / "published.pth")
    settings = json.loads((tested / "trained" / "run.json").read_text())["model"]
    save_model(tmp_path / "plain.safetensors", model, settings.pop("name"), settings | {"margin": 0})
    errors = []
    for file in ("published.pth", "plain.safetensors"):  # the published network predicts without a margin
        run = tmp_path / file.partition(".")[0]
        arguments = [f"evaluation.checkpoint={tmp_path}/{file}", "model.max_depth=10", f"hydra.run.dir={run}"]
        outcome = tiny(tested, "task=evaluate", *arguments)
        assert (outcome.code, outcome.err) == (0, "")
        errors.append(results(run)["metrics"])
    assert errors[0] == pytest.approx(errors[1], rel=1e-6)
    assert errors[0] != pytest.approx(results(tested / "tested")["metrics"], rel=1e-6)


def test_a_sweep_over_explorers_collects_the_random_frames_once(tiny, tested):
    before = moments(only(tested, "datasets/random-*")) | moments(only(tested, "datasets/test-*"))
    outcome = tiny(tested, "explore=random,frontier,deux", f"hydra.sweep.dir={tested}/sweep", "-m")
    assert (outcome.code, outcome.err) == (0, "")
    found = {path.parent.name: json.loads(path.read_text()) for path in tested.glob("sweep/*/results.json")}
    assert sorted(result["explore"] for result in found.values()) == ["deux", "frontier", "random"]
    assert len({json.dumps(result["baseline"]) for result in found.values()}) == 1  # the same test frames
    metrics = {result["explore"]: result["metrics"] for result in found.values()}
    assert metrics["random"] != metrics["frontier"]  # on the map of such a seed model, deux also moves at random
    names = sorted(path.name.partition("-")[0] for path in tested.glob("datasets/[!.]*"))
    assert names == ["deux", "frontier", "random", "test"]
    assert before == {path: path.stat().st_mtime_ns for path in before}
    assert len(list(tested.glob("seed_models/kbnet-*/model.safetensors"))) == 1


def test_poses_can_be_learned_with_the_depth(tiny, collected, tmp_path):
    options = [f"training_data={only(collected, 'datasets/random-*')}", "pose=learned", "training.steps=3"]
    outcome = tiny(tmp_path, "task=train", *options, f"hydra.run.dir={tmp_path}/run")
    assert (outcome.code, outcome.err) == (0, "")
    model = package.load(tmp_path / "run")
    assert all(weight.isfinite().all() for weight in model.parameters())
    network = model.pose_network()
    checkpoint = torch.load(only(tmp_path, "run/checkpoints/*.ckpt"), weights_only=True)
    weights = {name: checkpoint["state_dict"][f"pose_source.network.{name}"] for name in network.state_dict()}
    network.load_state_dict(weights)
    optimised = [weight for module in (model, network) for weight in module.parameters() if weight.requires_grad]
    state = checkpoint["optimizer_states"][0]["state"]
    assert [values["exp_avg"].shape for values in state.values()] == [weight.shape for weight in optimised]
    assert all(values["exp_avg"].abs().max() > 0 for values in state.values())  # all have had gradients


def world_points(dataset: Path) -> np.ndarray:
    """All points that a dataset's ground truth holds, in world coordinates, N x 3."""
    points = []
    for sequence in sequences(dataset):
        inverse = np.linalg.inv(read_intrinsics(sequence.intrinsics))
        for frame in sequence.frames():
            depth, pose = (
                read_depth(sequence.file("ground_truth", frame)),
                read_pose(sequence.file("absolute_pose", frame)),
            )
            v, u = np.nonzero(depth)
            rays = np.stack([u, v, np.ones_like(u)], axis=1) @ inverse.T
            points.append((rays * depth[v, u, None]) @ pose[:3, :3].T + pose[:3, 3])
    return np.concatenate(points)


def test_scenes_from_files_are_explored_where_they_are(tiny, room, tmp_path):
    train, test = room("furnished", "floor", "walls", "furniture"), room("empty", "floor", "walls")
    scenes = ["scenes=files", f"scenes.train=[{train}]", f"scenes.test={test}", f"hydra.run.dir={tmp_path}/run"]
    outcome = tiny(tmp_path, "explore=random", *scenes)
    assert (outcome.code, outcome.err) == (0, "")
    assert results(tmp_path / "run")["frames"] == 8  # all of them: the first two have source frames after them
    for pattern, scene in (("random-*", "furnished"), ("test-*", "empty")):
        dataset = only(tmp_path / "datasets", pattern)
        assert all(sequence.name.startswith(f"{scene}-") for sequence in sequences(dataset))
        points = world_points(dataset)
        assert (np.abs(points[:, [0, 2]]) < 2.02).all()
        assert (np.abs(points[:, 1] - 1.25) < 1.27).all()
        assert points[:, 1].min() < 0.02  # the floor, at height 0


@pytest.mark.slow
@pytest.mark.parametrize("name", ["small_house.glb", "lounge.ply"])
def test_real_scenes_are_explored(tiny, shared_data, tmp_path, name):
    scenes = ["scenes=files", f"scenes.train=[{shared_data('scenes') / name}]", "scenes.test=[]"]
    outcome = tiny(tmp_path, "task=collect", "explore=frontier", *scenes, "verification.min_depth=0.1")
    assert (outcome.code, outcome.err) == (0, "")
    assert read_manifest(only(tmp_path, "datasets/frontier-*"))["triplets"] > 0


def test_the_other_renderer_sees_the_same(tiny, collected, tmp_path):
    try:
        EGLContext(8, 8)
    except DeuxError as error:
        pytest.skip(str(error))
    outcome = tiny(tmp_path, "task=collect", "explore=random", "simulator.renderer=pyrender")
    assert (outcome.code, outcome.err) == (0, "")
    embree, pyrender = (sequences(only(o, "datasets/random-*"))[0] for o in (collected, tmp_path))
    for frame in embree.frames():
        poses = [read_pose(sequence.file("absolute_pose", frame)) for sequence in (embree, pyrender)]
        np.testing.assert_array_equal(*poses)
        depths = [read_depth(sequence.file("ground_truth", frame)) for sequence in (embree, pyrender)]
        images = [read_image(sequence.file("image", frame)).astype(float) for sequence in (embree, pyrender)]
        assert np.median(np.abs(depths[0] - depths[1])) <= 1 / 256
        assert np.median(np.abs(images[0] - images[1])) <= 3


def test_source_frames_of_a_dataset_that_lists_none(tiny, collected, tmp_path):
    dataset = tmp_path / only(collected, "datasets/random-*").name
    shutil.copytree(only(collected, "datasets/random-*"), dataset)
    (dataset / "train_triplets.txt").unlink()
    arguments = ["task=train", f"training_data={dataset}", f"hydra.run.dir={tmp_path}/run", "training.sources=recent"]
    sentence = tiny(tmp_path, *arguments, "training.offsets=[-4,4]").sentence  # of eight in all
    assert sentence.startswith(
        f"None of the 6 train frames of {dataset} has source frames: the frames at the offsets -4 and +4"
    )
    outcome = tiny(tmp_path, *arguments, "training.offsets=[-3,3]")
    assert (outcome.code, outcome.err) == (0, "")


def test_the_figure_of_test_frames_has_their_residual(deux, tiny_arguments, model_file, tmp_path, monkeypatch):
    drawn = []

    def draw(samples):
        drawn.extend(samples)
        return draw_depth_panels(samples)

    monkeypatch.setattr(depth_figures, "draw_depth_panels", draw)
    checkpoint = f"evaluation.checkpoint={model_file('kbnet')}"
    outcome = deux(*tiny_arguments(tmp_path, "task=evaluate", checkpoint, f"hydra.run.dir={tmp_path}/run"))
    assert outcome.code == 0, outcome.err
    assert len(drawn) == 3
    assert all(np.isfinite(sample.residual).any() for sample in drawn)
