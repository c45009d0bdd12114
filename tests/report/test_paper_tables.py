import json

import pytest
from scipy import stats

from deux.report.comparable_runs import group_comparable
from deux.report.display_names import Variant
from deux.report.paper_tables import table_one, table_three, table_two
from deux.report.runs import find_runs


def compare(outputs):
    return group_comparable(find_runs(outputs), [])


def means(row) -> list[float | None]:
    return [cell.estimate and pytest.approx(cell.estimate.mean) for cell in row.cells]


def mark(table, part: int, row: int, column: int) -> str | None:
    return table.parts[part][row].cells[column].mark


def test_table_one_has_explorers_by_models(write_run, outputs, names):
    for seed in range(3):
        write_run("random", "kbnet", seed, 30.0 + seed)
        write_run("deux", "kbnet", seed, 20.0)
        write_run("deux", "voiced", seed, 40.0)
    (runs,) = compare(outputs)
    table = table_one(runs, names, "apartments")
    assert table.groups == ("VOICED", "KBNet")
    assert [[row.labels[0] for row in part] for part in table.parts] == [["Interpolation"], ["Random"], ["DEUX"]]
    assert means(table.parts[0][0]) == [80.0, 180.0, 70.0, 150.0] * 2
    assert means(table.parts[1][0]) == [None] * 4 + [31.0, 62.0, 93.0, 969.0]
    assert means(table.parts[2][0]) == [40.0, 80.0, 120.0, 960.0, 20.0, 40.0, 60.0, 980.0]
    assert table.parts[1][0].cells[4].estimate.half_width == pytest.approx(stats.t.ppf(0.975, 2) / 3**0.5)
    assert mark(table, 2, 0, 4) == "best"  # interpolation, at 80, is not ranked
    assert mark(table, 1, 0, 4) == "second"
    assert mark(table, 1, 0, 7) == "best"
    assert "apartments" in table.caption
    assert "MAE and RMSE in mm, iMAE and iRMSE in 1/km; lower is better." in table.notes
    assert any("over n = 3 seeds (0, 1, 2)" in note for note in table.notes)


def test_a_note_compares_explorers_seed_by_seed(write_run, outputs, names):
    """What a seed does to both, here 10 mm to and fro, is in neither the difference nor its interval."""
    for seed, common in enumerate((30.0, 50.0, 40.0)):
        write_run("random", "kbnet", seed, common)
        write_run("deux", "kbnet", seed, common - 5.0 + seed)
    write_run("novelty", "kbnet", 0, 10.0)
    (runs,) = compare(outputs)
    interval = stats.t.ppf(0.975, 2) / 3**0.5
    assert table_one(runs, names, "apartments", baseline="random").notes[0] == (
        "KBNet, difference to Random's MAE with the same seed (below 0 is better; Student's t over the seeds): "
        f"DEUX -4.0 ± {interval:.1f}."
    )
    both = table_one(runs, names, "apartments", baseline=("random", "deux")).notes
    assert both[0] == table_one(runs, names, "apartments", baseline="random").notes[0]
    assert "KBNet, difference to DEUX's MAE with the same seed" in both[1]
    assert "Random +4.0" in both[1]
    for baseline in (None, "frontier"):
        notes = table_one(runs, names, "apartments", baseline=baseline).notes
        assert not any("same seed" in note for note in notes)


def test_the_ceiling_stands_apart_and_a_note_tells_the_share_of_the_way_to_it(write_run, outputs, names):
    """DEUX halves what every seed leaves between Random and the ceiling; a fourth seed without DEUX does not count."""
    for seed, (start, end) in enumerate(((40.0, 20.0), (44.0, 20.0), (39.0, 21.0))):
        write_run("random", "kbnet", seed, start)
        write_run("viewpoints", "kbnet", seed, end)
        write_run("deux", "kbnet", seed, (start + end) / 2)
        write_run("novelty", "kbnet", seed, start - 6.0 * seed)
    write_run("random", "kbnet", 3, 90.0)
    write_run("viewpoints", "kbnet", 3, 1.0)
    (runs,) = compare(outputs)
    table = table_one(runs, names, "apartments", baseline="random")
    last = table.parts[-1]
    assert len(last) == 1
    assert not last[0].ranked
    assert "viewpoints" in last[0].labels[0]
    assert {mark(table, -1, 0, column) for column in range(4)} == {None}
    (note,) = [note for note in table.notes if "share of the way" in note]
    assert "DEUX 50 ± 0 %" in note
    found = runs.relative_gain(Variant("novelty"), Variant("random"), Variant("viewpoints"), Variant("kbnet"))
    gain, way = [0.0, 6.0, 12.0], [20.0, 24.0, 18.0]
    share = sum(gain) / sum(way)
    spread = stats.t.interval(0.95, 2, 0, stats.sem([g - share * w for g, w in zip(gain, way, strict=True)]))[1]
    assert found == pytest.approx((share, spread * 3 / sum(way)))


def test_there_is_no_share_where_the_ceiling_is_not_below(write_run, outputs, names):
    for seed in range(2):
        write_run("random", "kbnet", seed, 30.0 + seed)
        write_run("viewpoints", "kbnet", seed, 31.0 - seed)
        write_run("deux", "kbnet", seed, 20.0)
    (runs,) = compare(outputs)
    assert not any("share of the way" in note for note in table_one(runs, names, "a", baseline="random").notes)


def test_table_two_sets_models_of_the_first_dataset_beside_those_of_the_other(write_run, outputs, names, here, there):
    for explorer, mae in (("random", 30.0), ("deux", 20.0)):
        write_run(explorer, "kbnet", 0, mae, place=there)
        write_run(explorer, "kbnet", 0, mae + 5, place=there, trained_in=here)
    home, away = sorted(compare(outputs), key=lambda runs: runs.transferred)
    table = table_two(home, [away], names, ("first", "other"), ["deux"])
    assert [[row.labels for row in part] for part in table.parts] == [
        [("Interpolation", "")],
        [("KBNet", "Random"), ("KBNet", "DEUX"), ("KBNet", "DEUX*")],
    ]
    assert [row.cells[0].estimate.mean for row in table.parts[1]] == [30.0, 20.0, 25.0]
    assert [mark(table, 1, row, 0) for row in range(3)] == [None, "best", "second"]
    assert table.notes[0] == "*: trained on first."


def test_table_three_averages_over_the_models_seed_by_seed(write_run, outputs, names, here, there):
    maes = {("deux", "kbnet"): (10.0, 12.0, 17.0), ("deux", "voiced"): (30.0, 36.0, 31.0)}
    maes |= {("random", "kbnet"): (20.0, 20.0, 20.0), ("random", "voiced"): (20.0, 20.0, 20.0)}
    for (explorer, model), values in maes.items():
        for seed, mae in enumerate(values):
            write_run(explorer, model, seed, mae, place=there, trained_in=here)
    (runs,) = compare(outputs)
    table = table_three(runs, names, "first", "other")
    deux = table.parts[2][0]
    each = [20.0, 24.0, 24.0]
    assert deux.cells[0].estimate.mean == pytest.approx(sum(each) / 3)
    assert deux.cells[0].estimate.half_width == pytest.approx(stats.t.ppf(0.975, 2) * stats.sem(each))
    assert [mark(table, part, 0, 0) for part in (1, 2)] == ["best", "second"]
    assert table.caption.endswith("trained on first, tested on other")
    assert "VOICED, KBNet" in table.notes[0]


def test_table_three_reports_where_models_are_missing(write_run, outputs, names, here, there):
    for seed, models in enumerate((("kbnet", "voiced"), ("kbnet",), ("kbnet",))):
        for model in models:
            write_run("deux", model, seed, 20.0, place=there, trained_in=here)
    for seed in range(2):
        write_run("random", "kbnet", seed, 10.0, place=there, trained_in=here)
    (runs,) = compare(outputs)
    _, (random,), (deux,) = table_three(runs, names, "first", "other").parts
    assert (deux.labels, deux.ranked, deux.cells[0].seeds) == (("DEUX",), True, (0,))  # the one seed with all models
    assert (random.labels, random.ranked, random.cells[0].seeds) == (("Random (KBNet only)",), False, (0, 1))


def test_runs_that_cannot_be_compared_are_pointed_out(write_run, outputs, names):
    write_run("random", "kbnet", 0, 10.0)
    write_run("random", "kbnet", 0, 10.0, folder="again")
    path = write_run("deux", "kbnet", 0, 10.0) / "results.json"
    path.write_text(path.read_text().replace('"mae": 80.0', '"mae": 90.0'))
    (runs,) = compare(outputs)
    notes = " ".join(table_one(runs, names, "apartments").notes)
    assert "Not all runs were tested on the same frames" in notes
    assert "Duplicate runs with equal errors, which are counted once: 1." in notes
    assert "One seed (0), thus without intervals" in notes


def test_a_note_compares_explorers_scene_by_scene_where_results_have_scenes(write_run, outputs, names):
    for seed in range(2):
        for explorer, mae in (("random", 30.0), ("deux", 26.0)):
            path = write_run(explorer, "kbnet", seed, mae) / "results.json"
            results = json.loads(path.read_text())
            errors = {"frames": 8, "metrics": results["metrics"], "baseline": results["baseline"]}
            scenes = [{"scene": f"flat {number}", **errors} for number in range(8)]
            path.write_text(json.dumps({**results, "scenes": scenes}))
    (runs,) = compare(outputs)
    notes = table_one(runs, names, "apartments", baseline="random").notes
    assert "KBNet, the same with the same seed and scene (bootstrap over seeds and over the scenes of each;" in notes[1]
    assert notes[1].endswith(": DEUX -4.0 ± 0.0.")
