"""The presets of the paper's two datasets compose to its own settings, and take a small copy of the set."""

import pytest
import trimesh

from deux.collection.collect_settings import CollectSettings
from deux.collection.sparse import SparseSettings, point_count
from deux.configuration import compose
from deux.contracts import Robot
from deux.geometry.camera import Camera
from deux.options import construct
from deux.registry import registry
from deux.training.training_settings import TrainingSettings


@pytest.fixture
def root(tmp_path):
    """The first scene of each split of either set."""
    for place in (
        "mp3d/17DRP5sb8fy/17DRP5sb8fy.glb",
        "mp3d/2azQ1b91cZZ/2azQ1b91cZZ.glb",
        "mp3d/2t7WUuJeko7/2t7WUuJeko7.glb",
        "hm3d/train/00000-abcdefgh000/abcdefgh000.glb",
        "hm3d/minival/00800-abcdefgh800/abcdefgh800.glb",
        "hm3d/val/00810-abcdefgh810/abcdefgh810.glb",
    ):
        (tmp_path / place).parent.mkdir(parents=True)
        trimesh.creation.box([4, 3, 2.5]).export(tmp_path / place)
    return tmp_path


@pytest.mark.parametrize("preset", ["paper_mp3d", "paper_hm3d"])
def test_the_settings_are_the_papers(preset):
    cfg = compose([f"experiment={preset}", "scenes.root=scans"])
    camera, robot = construct(Camera, cfg.camera, "camera"), construct(Robot, cfg.robot, "robot")
    assert (camera.width, camera.height, camera.hfov) == (400, 400, 90.0)
    assert (camera.min_depth, camera.max_depth) == (0.1, 10.0)
    assert (robot.radius, robot.height, robot.camera_height) == (0.1, 1.5, 1.25)
    assert (robot.forward_step, robot.turn_angle) == (0.25, 10.0)
    assert construct(CollectSettings, cfg.collect, "collect").steps == 500
    sparse = construct(SparseSettings, cfg.sampling, "sampling")
    assert point_count((camera.height, camera.width), sparse) == 1500
    training = construct(TrainingSettings, cfg.training, "training")
    assert (training.epochs, training.steps, training.crop) == (25, None, (384, 384))
    rates = [training.learning_rate * training.factor(0, 0.0, epoch) for epoch in range(training.epochs)]
    assert rates == [1e-4] * 10 + [5e-5] * 15
    assert (cfg.model.name, cfg.explore.name, cfg.seed_model.explore) == ("kbnet", "deux", "random")
    assert cfg.explore == compose(["explore=deux_paper"]).explore
    assert (cfg.collect.uncertainty, cfg.collect.correct_depth) == ("l1", False)
    assert cfg.trainer.gradient_clip_val is None
    assert training.betas == (0.9, 0.999)


@pytest.mark.parametrize(
    ("preset", "sizes"), [("paper_mp3d", (61, 11, 18)), ("paper_hm3d", (800, 10, None))], ids=["mp3d", "hm3d"]
)
def test_the_splits_are_the_papers(preset, sizes):
    scenes = compose([f"experiment={preset}", "scenes.root=scans"]).scenes
    assert (scenes.train, scenes.validation, scenes.test) == sizes


@pytest.mark.parametrize("model", ["kbnet", "voiced", "fusionnet", "scaffnet"])
@pytest.mark.parametrize("preset", ["paper_mp3d", "paper_hm3d"])
def test_every_model_is_the_published_one_at_the_papers_rate(preset, model):
    cfg = compose([f"experiment={preset}", f"model={model}", "scenes.root=scans"])
    assert cfg.model.margin == 0
    training = cfg.training
    assert (training.learning_rate, training.batch_size) == (1e-4, 8)


@pytest.mark.parametrize("preset", ["paper_mp3d", "paper_hm3d"])
def test_the_published_start_is_an_option_away(preset):
    """As the presets' comments and docs/scans.md say."""
    for start, chosen in (("he", []), ("glorot", ["model.first_weights=glorot"])):
        cfg = compose([f"experiment={preset}", "scenes.root=scans", *chosen])
        assert registry().choose("depth_models", cfg.model).settings["first_weights"] == start


@pytest.mark.parametrize(
    ("preset", "further"), [("paper_mp3d", []), ("paper_hm3d", ["scenes.validation=[00800]", "scenes.test=[00810]"])]
)
def test_a_small_copy_will_do_for_a_quick_run(root, preset, further):
    cfg = compose([f"experiment={preset}", f"scenes.root={root}", "scenes.limit=1", *further])
    splits = registry().choose("scenes", cfg.scenes).create().splits()
    assert [len(scenes) for scenes in (splits.train, splits.validation, splits.test)] == [1, 1, 1]
