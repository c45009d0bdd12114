import json

import pytest
from rich.console import Console

from deux.errors import DeuxError
from deux.report.results import Results

ERRORS = {"mae": 1.0, "rmse": 2.0, "imae": 3.0, "irmse": 4.0}


def results(**changes) -> Results:
    values = {"model": "kbnet", "explore": "deux", "seed": 3, "frames": 12, "seconds": {"collect": 1.5}}
    errors = {"metrics": ERRORS, "baseline": ERRORS, "constant": ERRORS}
    return Results(**{**values, **errors, **changes})


def test_round_trip(tmp_path):
    results().save(tmp_path)
    assert Results.load(tmp_path) == results()
    assert not list(tmp_path.glob("*.partial"))
    assert json.loads((tmp_path / "results.json").read_text())["metrics"] == ERRORS


def test_results_of_a_version_that_knew_no_rounds_are_read(tmp_path):
    rounds = [{"round": 1, "step": 40, "frames": 12, "area": 8.5, "uncertainty": None, "mae": 250.0}]
    results(rounds=rounds).save(tmp_path)
    assert Results.load(tmp_path).rounds == rounds
    content = json.loads((tmp_path / "results.json").read_text())
    del content["rounds"]
    (tmp_path / "results.json").write_text(json.dumps(content))
    assert Results.load(tmp_path) == results()


def test_the_errors_of_corrected_depth_stand_below_the_models_and_may_be_missing(tmp_path):
    corrected = {**ERRORS, "mae": 0.25}
    results(corrected=corrected).save(tmp_path)
    assert Results.load(tmp_path).corrected == corrected
    rows = Results.load(tmp_path).table().rows
    assert [row.labels[0] for row in rows][:2] == ["kbnet, deux frames", "the same, corrected by the points"]
    content = json.loads((tmp_path / "results.json").read_text())
    del content["corrected"]  # as in results of earlier versions
    (tmp_path / "results.json").write_text(json.dumps(content))
    assert Results.load(tmp_path) == results()
    (tmp_path / "results.json").write_text(json.dumps({**content, "corrected": {"mae": 1.0}}))
    with pytest.raises(DeuxError, match="it has no number for rmse"):
        Results.load(tmp_path)


def test_what_is_wrong_with_a_file_is_named_in_the_error(tmp_path):
    with pytest.raises(DeuxError, match="give the folder of a finished run"):
        Results.load(tmp_path)
    (tmp_path / "results.json").write_text('{"model": 1}')
    with pytest.raises(DeuxError, match="not a results file of deux"):
        Results.load(tmp_path)


def test_the_table_marks_the_lowest_error():
    console = Console(width=140, color_system="standard", force_terminal=True)
    with console.capture() as capture:
        console.print(results(baseline={**ERRORS, "mae": 0.5}).table())
    assert "\x1b[1m0.5\x1b[0m" in capture.get()
    assert "\x1b[1m1.0\x1b[0m" not in capture.get()


def test_the_tables_columns_have_the_metrics_names_and_units():
    table = results().table()
    assert table.headings == ("MAE [mm]", "RMSE [mm]", "iMAE [1/km]", "iRMSE [1/km]")
    assert [row.labels[0] for row in table.rows] == [
        "kbnet, deux frames",
        "interpolated points",
        "median of the points",
    ]
    assert table.caption == "Errors on the test frames (12 training frames, seed 3)"
    assert "| kbnet, deux frames | 1.0 | 2.0 | 3.0 | 4.0 |" in results().table().markdown().replace("**", "")


def test_the_table_lists_how_many_frames_and_what_the_baselines_stand_for():
    table = results(images=30, without_truth=2, without_points=3).table()
    assert table.caption == "Errors on the 30 test frames (12 training frames, seed 3)"
    assert table.notes == (
        "2 of the test frames have no ground truth in range and are left out.",
        "3 of the test frames have no sparse point; interpolation and median use the median depth of the other frames "
        "there.",
    )
    assert results(images=30).table().notes == ()


def test_errors_by_scene_are_kept_and_checked(tmp_path):
    scene = {"scene": "flat", "frames": 40, "metrics": ERRORS, "baseline": ERRORS}
    results(scenes=[scene]).save(tmp_path)
    assert Results.load(tmp_path).scenes == [scene]
    for broken in ({**scene, "metrics": {}}, {"scene": "flat"}, {**scene, "frames": 0}):
        results(scenes=[broken]).save(tmp_path)
        with pytest.raises(DeuxError, match="not a results file of deux"):
            Results.load(tmp_path)
