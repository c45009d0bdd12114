from dataclasses import replace

import numpy as np
import pytest
from box_scenes import SCENES, BoxRoomSimulator, FarModel, box_simulation, explorer, measure

from deux.collection.sparse import SparseSettings
from deux.contracts import SceneArea
from deux.errors import DeuxError
from deux.registry import registry
from deux.studies.evaluated_walk import CONTROLS
from deux.studies.uncertainty_episodes import installed_measures, study_uncertainty

MEASURES = [measure("l1"), measure("sparse_error")]


@pytest.fixture
def study():
    """study(folder, model, **changes): the frontier explorer in both scenes, eight steps."""
    with box_simulation() as simulation:

        def run(folder, model=None, **changes):
            given = {
                "scenes": SCENES,
                "explorer": explorer("frontier"),
                "predict_depth": model or FarModel(),
                "sparse": SparseSettings(0.02),
                "measures": MEASURES,
                "seed": 3,
                "steps": 8,
            }
            return study_uncertainty(folder, simulation, **(given | changes))

        yield run


def test_every_measure_is_evaluated_in_every_frame_with_two_before_it(study, tmp_path):
    found = study(tmp_path)
    assert found.names == ("l1", "sparse_error", *CONTROLS)
    assert found.scenes == tuple(reference.name for reference in SCENES)
    for walk, reference in zip(found.walks, SCENES, strict=True):
        assert walk.scene == reference.name
        assert [frame.step for frame in walk.frames] == list(range(2, 8))
        assert all(set(frame.scores) >= {"sparse_error", *CONTROLS} for frame in walk.frames)


def test_every_floor_is_walked_where_all_are_asked_for(study, tmp_path, two_floors):
    found = study(tmp_path, scenes=(replace(SCENES[0], area=SceneArea(floor="all")), SCENES[1]))
    assert [(walk.scene, walk.floor) for walk in found.walks] == [("short", 0), ("short", 1), ("long", 0)]
    assert found.scenes == ("short", "long")
    assert {path.name for path in tmp_path.glob("*.json")} == {"short.json", "short-floor1.json", "long.json"}


@pytest.mark.parametrize("guided", [False, True])
def test_no_frame_is_predicted_twice(study, tmp_path, guided):
    model = FarModel()
    walker = {"explorer": explorer("deux"), "guidance": MEASURES[0]} if guided else {}
    study(tmp_path, model, **walker)
    assert len(model.frames) == 2 * 8


def test_the_measure_that_guides_is_computed_once(study, tmp_path):
    model = FarModel()
    flip = measure("flip")
    study(tmp_path, model, explorer=explorer("deux"), guidance=flip, measures=[flip])
    assert len(model.frames) == 2 * (8 + 6)  # each frame, and each mirrored frame that has two before it


def test_a_measure_that_guides_need_not_be_evaluated(study, tmp_path):
    found = study(tmp_path, explorer=explorer("deux"), guidance=measure("ssim"))
    assert found.measures == ("l1", "sparse_error")


def test_a_measure_that_sees_the_errors_beats_chance(study, tmp_path):
    """The sparse points show where the model, which knows nothing of the room, is wrong."""
    found = study(tmp_path)
    assert found.pixels("sparse_error").mean > 0.3
    assert abs(found.pixels("chance").mean) < 0.1
    assert found.ause("sparse_error").mean < 0.7 * found.ause("chance").mean


def test_some_frames_of_the_first_scene_are_shown(study, tmp_path):
    shown = []
    study(tmp_path, show=shown.extend)
    assert len(shown) == 5
    for sample in shown:
        assert set(sample.uncertainties) == {"l1", "sparse_error", *CONTROLS}
        known = np.isfinite(sample.error)
        distance = sample.uncertainties["distance"]
        np.testing.assert_allclose(distance, 3.0 - sample.rgb.mean(axis=2) / 255.0, atol=1e-5)
        assert known.any()


def test_a_finished_scene_is_read(study, tmp_path):
    whole = study(tmp_path)
    (tmp_path / "long.json").unlink()
    BoxRoomSimulator.loaded.clear()
    shown, told = [], []
    again = study(tmp_path, show=shown.extend, progress=lambda stage, done, total: told.append((stage, done, total)))
    assert again.walks == whole.walks
    assert BoxRoomSimulator.loaded == ["long"]
    assert shown == []
    assert told == [("scenes", 1, 2), ("scenes", 2, 2)]
    (tmp_path / "long.json").write_text("{}")
    with pytest.raises(DeuxError, match=r"long\.json is damaged, it is not an evaluated walk"):
        study(tmp_path)


def test_walks_that_are_too_short_are_an_error(study, tmp_path):
    with pytest.raises(DeuxError, match="no frame of the 2 scenes could be evaluated"):
        study(tmp_path, steps=2)


def test_an_explorer_that_needs_a_measure_must_be_given_one(study, tmp_path):
    with pytest.raises(DeuxError, match="there is no measure of uncertainty"):
        study(tmp_path, explorer=explorer("deux"))


def test_all_installed_measures_are_found_and_a_broken_one_is_left_out(monkeypatch):
    measures, left_out = installed_measures()
    assert {"l1", "ssim", "parallax", "flip", "hidden_points", "sparse_error"} <= {choice.name for choice in measures}
    assert left_out == {}
    names = registry().names

    def with_another(kind: str) -> list[str]:
        return [*names(kind), "nowhere"]

    monkeypatch.setattr(registry(), "names", with_another)
    measures, left_out = installed_measures()
    assert "there is no measure of uncertainty called 'nowhere'" in left_out["nowhere"]
    cls = registry().get("uncertainties", "ssim")

    def refuse(self: object, *arguments: object, **options: object) -> None:
        raise ValueError("no\nwindow")

    monkeypatch.setattr(cls, "__init__", refuse)
    assert installed_measures()[1]["ssim"] == "ssim cannot be created: ValueError: no window."
