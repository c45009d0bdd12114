"""`experiment=adaptation`: an included model is adapted to the scene in which it is tested."""

import json

from deux import available
from deux.configuration import compose


def test_the_preset_tests_in_the_scenes_that_are_explored():
    cfg = compose(["experiment=adaptation", "scenes.train=[hall.glb,attic.ply]"])
    assert (cfg.scenes.test, cfg.scenes.validation) == (["hall.glb", "attic.ply"], [])
    assert cfg.training.start == cfg.seed_model.checkpoint == "kbnet-indoor"
    assert cfg.training.start in available()


def test_a_model_is_adapted_to_the_scene_of_a_file(deux, room, tmp_path, monkeypatch):
    scene = room("home", "floor", "walls", "furniture")
    monkeypatch.chdir(scene.parent)
    small = ["camera.width=32", "camera.height=32", "collect.steps=12", "training.steps=2", "evaluation.viewpoints=3"]
    folders = [f"paths.outputs={tmp_path}", f"hydra.run.dir={tmp_path}/run"]
    outcome = deux("experiment=adaptation", f"scenes.train=[{scene.name}]", *small, *folders)
    assert (outcome.code, outcome.err) == (0, "")
    assert "starting from kbnet-indoor" in outcome.out
    results = json.loads((tmp_path / "run" / "results.json").read_text())
    assert (results["explore"], [each["scene"] for each in results["scenes"]]) == ("deux", ["home"])
