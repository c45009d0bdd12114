"""The study of the smallest size, and all that it leaves behind."""

import csv
import json

import cv2
import pytest

SMALL = ["task=study_uncertainty", "explore=frontier", "scenes.test=2", "collect.steps=6"]


@pytest.fixture(scope="module")
def finished(tiny, tmp_path_factory):
    folder = tmp_path_factory.mktemp("studied") / "run"
    outcome = tiny(folder.parent, *SMALL, f"hydra.run.dir={folder}", figures=True)
    assert (outcome.code, outcome.err) == (0, "")
    assert "Uncertainty against the true error" in outcome.out
    return folder


def test_everything_that_a_study_leaves_behind(finished):
    results = json.loads((finished / "results.json").read_text())
    assert results["scenes"] == ["apartment_200000", "apartment_200001"]
    assert results["frames"] == 8  # the first two of six have no two frames before them
    assert -1.0 <= results["measures"]["l1"]["rank_correlation_pixels"] <= 1.0
    with (finished / "frames.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert {row["measure"] for row in rows} >= {"l1", "ssim", "flip", "hidden_points", "sparse_error", "chance"}
    assert {(row["scene"], row["step"]) for row in rows} == {
        (s, str(n)) for s in results["scenes"] for n in range(2, 6)
    }
    assert "| sparse_error |" in (finished / "table.md").read_text()
    for figure in ("sparsification", "frames", "maps"):
        assert cv2.imread(str(finished / "figures" / f"{figure}.png")).std() > 10


def test_a_finished_scene_is_not_walked_through_again(finished, tiny):
    record = finished / "episodes" / "apartment_200000.json"
    content = json.loads(record.read_text())
    content["frames"][0]["error"] = 12345.0
    record.write_text(json.dumps(content))
    (finished / "results.json").unlink()
    assert tiny(finished.parent, *SMALL, f"hydra.run.dir={finished}").code == 0
    assert "12345.0" in (finished / "frames.csv").read_text()
    record.write_text("{}")
    outcome = tiny(finished.parent, *SMALL, f"hydra.run.dir={finished}")
    assert outcome.code == 1
    assert "apartment_200000.json is damaged" in outcome.err


def test_an_explorer_that_the_model_guides(tiny, tmp_path):
    outcome = tiny(tmp_path, *SMALL, "explore=deux", "collect.uncertainty=flip", "scenes.test=1")
    assert (outcome.code, outcome.err) == (0, "")


def test_without_test_scenes(tiny, tmp_path):
    outcome = tiny(tmp_path, *SMALL, "scenes.test=0")
    assert outcome.code == 1
    assert "scenes.test" in outcome.err
