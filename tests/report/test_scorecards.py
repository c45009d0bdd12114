"""The table of scorecards, and the rank correlations of their entries with MAE, against ones that are known."""

import dataclasses

import numpy as np
import pytest
from scipy import stats

from deux.metrics.scorecard import Scorecard
from deux.report.comparable_runs import group_comparable
from deux.report.contents import read_contents
from deux.report.runs import find_runs
from deux.report.scorecards import ENTRIES, correlation_table, scorecard_table

CARD = Scorecard(
    frames=18, sampled=18, parallax=0.5, moved=0.4, places=7, views=9, near=0.2, middle=0.5, far=0.3, depth_distance=0.1
)


@pytest.fixture
def write_scored(write_run):
    """Write a run with a scorecard: write_scored(explorer, model, seed, mae, entries, ...)."""

    def write(explorer, model, seed, mae, entries=None, **options):
        run = write_run(explorer, model, seed, mae, **options)
        dataclasses.replace(CARD, **(entries or {})).save(run)
        return run

    return write


def groups(folder):
    return group_comparable(find_runs(folder), [])


def table(folder, names):
    (group,) = groups(folder)
    return scorecard_table(group, names, "Scorecards", "scorecards")


def shown(table, row, entry):
    cell = next(one for one in table.rows if one.labels[0] == row).cells[list(ENTRIES).index(entry)]
    return None if cell.estimate is None else cell.estimate.mean


def correlations(table, group=0):
    """By the entry's title: rank correlation and number of runs."""
    found = {}
    for row in table.rows:
        correlation, count = row.cells[2 * group : 2 * group + 2]
        found[row.labels[0]] = correlation.estimate and (correlation.estimate.mean, count.estimate.mean)
    return found


def test_a_row_is_the_mean_over_an_explorers_runs_in_the_reports_order(write_scored, write_run, outputs, names):
    for seed, parallax in enumerate((0.5, 0.7)):
        write_scored("deux", "kbnet", seed, 20.0, {"parallax": parallax, "actions": 40, "bumps": 2.5})
        write_scored("random", "kbnet", seed, 22.0, {"parallax": 0.2})
        write_scored("viewpoints", "kbnet", seed, 18.0, {"parallax": 1.0})
    write_run("frontier", "kbnet", 0, 21.0)  # of an earlier version
    found = table(outputs, names)
    assert [[row.labels[0] for row in part] for part in found.parts] == [["Random"], ["DEUX"], ["viewpoints"]]
    assert shown(found, "DEUX", "parallax") == pytest.approx(0.6)
    assert (shown(found, "DEUX", "actions"), shown(found, "viewpoints", "actions")) == (40, None)
    assert not any(cell.mark for row in found.rows for cell in row.cells)
    assert "| 60.0 |" in found.markdown()


def test_a_mean_over_other_seeds_is_marked(write_scored, outputs, names):
    for seed in range(2):
        write_scored("random", "kbnet", seed, 22.0)
    write_scored("deux", "kbnet", 0, 20.0, {"parallax": 0.9})
    assert "90.0 (seed 0)" in table(outputs, names).markdown()


def test_runs_that_were_judged_with_other_source_frames_have_rows_of_their_own(write_scored, outputs, names):
    write_scored("random", "kbnet", 0, 22.0, {"sources": "baseline"})
    write_scored("random", "kbnet", 1, 22.0)
    assert [row.labels[0] for row in table(outputs, names).rows] == [
        "Random (sources: baseline)",
        "Random (sources: recent)",
    ]


def test_without_scorecards_there_is_no_table(write_run, outputs, names):
    write_run("random", "kbnet", 0, 20.0)
    assert table(outputs, names) is None
    assert read_contents(outputs, names).scorecards == ()


def test_what_a_seed_does_to_all_explorers_alike_does_not_count(write_scored, outputs, names):
    """Within each seed more parallax means a smaller error; over the seeds both grow together."""
    rng = np.random.default_rng(0)
    differences, errors = [], []
    for seed in range(3):
        parallax = rng.uniform(0.0, 0.1, 4)
        mae = 40.0 * (parallax + rng.normal(0, 0.02, 4)) * -1 + 20.0
        differences += (parallax - np.median(parallax)).tolist()
        errors += (mae - np.median(mae)).tolist()
        for explorer, one, error in zip(("random", "frontier", "novelty", "deux"), parallax, mae, strict=True):
            write_scored(
                explorer,
                "kbnet",
                seed,
                float(error) + 50.0 * seed,
                {"parallax": float(one) + 0.3 * seed, "views": 9 + seed},
            )
        write_scored("viewpoints", "kbnet", seed, 1.0, {"parallax": 0.0})  # would turn the sign
    found = correlation_table(groups(outputs), names)
    assert found.groups == ("KBNet",)
    expected = stats.spearmanr(differences, errors).statistic
    assert correlations(found)["parallax"] == (pytest.approx(expected), 12)
    assert expected < -0.4
    assert "views" not in correlations(found)  # alike for all explorers of a seed
    assert any("Below 0" in note for note in found.notes)
    assert any("ceiling, are left out" in note for note in found.notes)


def test_one_failed_training_does_not_turn_the_correlation(write_scored, outputs, names):
    """More parallax means a smaller error in each seed; a run in the middle of the first fails."""
    for seed in range(2):
        for number, explorer in enumerate(("random", "frontier", "novelty", "coverage", "deux")):
            failed = seed == 0 and explorer == "novelty"
            mae = 8000.0 if failed else 300.0 - 10.0 * number
            write_scored(explorer, "kbnet", seed, mae, {"parallax": 0.1 * number})
    correlation, _ = correlations(correlation_table(groups(outputs), names))["parallax"]
    assert correlation < -0.6  # with means taken off: -0.42


def test_budgets_and_models_are_not_mixed(write_scored, outputs, names):
    """KBNet errs less with more views, VOICED more; the longer budget has more views and smaller errors of its own."""
    for model, sign in (("kbnet", -1.0), ("voiced", 1.0)):
        for budget, folder in ((10, "short"), (900, "long")):
            for seed in range(2):
                for views, explorer in enumerate(("random", "deux")):
                    mae = 30.0 + sign * views + 10.0 * (budget == 10) + seed
                    write_scored(
                        explorer, model, seed, mae, {"views": views + budget}, folder=folder, training__steps=budget
                    )
    found = correlation_table(groups(outputs), names)
    assert found.groups == ("VOICED", "KBNet")
    assert correlations(found, 0)["views"] == (pytest.approx(1.0), 8)
    assert correlations(found, 1)["views"] == (pytest.approx(-1.0), 8)


@pytest.mark.parametrize(
    ("explorers", "seeds"), [(("deux",), 8), (("random", "deux"), 2), (("random", "viewpoints"), 8)]
)
def test_there_is_no_correlation_of_too_few_runs_or_of_one_explorer(write_scored, outputs, names, explorers, seeds):
    for seed in range(seeds):
        for number, explorer in enumerate(explorers):
            write_scored(explorer, "kbnet", seed, 20.0 + seed + number, {"parallax": 0.1 * (seed + number) / 2})
    assert correlation_table(groups(outputs), names) is None


def test_models_that_were_tested_elsewhere_do_not_count(write_scored, outputs, names, here, there):
    for seed in range(4):
        for number, explorer in enumerate(("random", "deux")):
            write_scored(explorer, "kbnet", seed, 20.0 + number, {"moved": number / 2}, place=there, trained_in=here)
    assert correlation_table(groups(outputs), names) is None


def test_an_entry_that_some_runs_lack_counts_over_the_others(write_scored, outputs, names):
    for seed in range(4):
        for number, explorer in enumerate(("random", "deux")):
            known = {"area": 10.0 + number} if seed else {}
            write_scored(explorer, "kbnet", seed, 20.0 - number, {"views": number, **known})
    found = correlations(correlation_table(groups(outputs), names))
    assert found["views"] == (pytest.approx(-1.0), 8)
    assert found["area seen"] == (pytest.approx(-1.0), 6)


def test_scorecards_of_other_source_frames_are_not_compared(write_scored, outputs, names):
    """Random's frames have less parallax than the others' by either choice, and are judged by the choice with more."""
    for seed in range(4):
        for number, explorer in enumerate(("frontier", "deux")):
            write_scored(explorer, "kbnet", seed, 20.0 - number, {"parallax": 0.4 + 0.1 * number})
        write_scored("random", "kbnet", seed, 30.0, {"parallax": 0.9, "sources": "baseline"})
    found = correlations(correlation_table(groups(outputs), names))
    assert found["parallax"] == (pytest.approx(-1.0), 8)


def test_each_budget_has_its_table_and_the_correlation_is_over_all(write_scored, outputs, names):
    for seed in range(3):
        for number, explorer in enumerate(("random", "deux")):
            for folder, steps in (("a", 10), ("b", 900)):
                write_scored(explorer, "kbnet", seed, 20.0, {"views": number}, folder=folder, training__steps=steps)
                write_scored(
                    explorer, "voiced", seed, 20.0 + number, {"views": number}, folder=folder, training__steps=steps
                )
    tables = read_contents(outputs, names).scorecards
    assert [one.name for one in tables] == ["scorecards", "scorecards_2", "scorecard_correlations"]
    assert tables[1].caption.endswith("test set, with training.steps=900")
    assert tables[2].groups == ("VOICED",)  # KBNet errs alike
