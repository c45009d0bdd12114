import pytest
from scipy import stats

from deux.report.comparison import comparisons, lone_sweeps
from deux.report.runs import find_runs
from deux.report.sweeps import find_sweeps

DEUX, RANDOM, KBNET, VOICED = ("deux", ""), ("random", ""), ("kbnet", ""), ("voiced", "")


def compare(outputs):
    return comparisons(find_runs(outputs), find_sweeps(outputs))


def test_only_equal_budgets_and_frames_stand_together(write_run, outputs, here, there):
    for seed in range(2):
        write_run("deux", "kbnet", seed, 10.0)
        write_run("random", "kbnet", seed, 10.0)
    write_run("deux", "kbnet", 0, 99.0, folder="long", training__steps=20)
    write_run("deux", "kbnet", 0, 99.0, folder="far", collect__steps=40)
    write_run("deux", "kbnet", 0, 99.0, folder="wide", camera__width=128)
    write_run("deux", "kbnet", 0, 99.0, folder="other", place=there)
    write_run("deux", "kbnet", 0, 99.0, folder="away", place=there, trained_in=here)
    found = compare(outputs)
    assert [len(comparison.finished) for comparison in found] == [4, 1, 1, 1, 1, 1]
    assert [comparison.transferred for comparison in found].count(True) == 1


def test_seeds_are_summed_up_cell_by_cell(write_run, outputs):
    values = {0: 10.0, 1: 14.0, 2: 11.0}
    for seed, mae in values.items():
        write_run("deux", "kbnet", seed, mae)
    (comparison,) = compare(outputs)
    mae, rmse, imae, irmse = comparison.errors(DEUX, KBNET)
    half = stats.t.ppf(0.975, 2) * stats.sem(list(values.values()))
    assert (mae.mean, mae.interval) == (pytest.approx(35 / 3), pytest.approx(half))
    assert (rmse.mean, imae.mean, irmse.mean) == pytest.approx((70 / 3, 35.0, 1000 - 35 / 3))
    assert comparison.errors(RANDOM, KBNET) is None
    assert [number.mean for number in comparison.baseline] == [80.0, 180.0, 70.0, 150.0]


def test_variants_of_an_explorer_are_rows_of_their_own(write_run, outputs):
    write_run("deux", "kbnet", 0, 10.0)
    write_run("deux", "kbnet", 0, 20.0, folder="other", explore__residual_pose="surface")
    (comparison,) = compare(outputs)
    assert comparison.explorers == {("deux", "residual_pose not set"), ("deux", "residual_pose=surface")}


def test_a_run_done_twice_counts_once_and_the_newest(write_run, outputs):
    write_run("deux", "kbnet", 0, 10.0)
    second = write_run("deux", "kbnet", 0, 20.0, folder="again")
    (second / "results.json").touch()
    (comparison,) = compare(outputs)
    assert (comparison.repeated, comparison.errors(DEUX, KBNET)[0].mean) == (1, 20.0)


def test_a_begun_run_that_was_finished_elsewhere_is_not_missing(write_run, outputs):
    write_run("deux", "kbnet", 0, None, folder="stopped")
    write_run("deux", "kbnet", 0, 20.0)
    (comparison,) = compare(outputs)
    assert (comparison.missing, len(comparison.finished)) == ((), 1)


def test_missing_is_what_the_occurring_values_call_for(write_run, outputs):
    write_run("deux", "kbnet", 0, 10.0)
    write_run("random", "voiced", 1, 10.0)
    write_run("random", "kbnet", 0, None)
    (comparison,) = compare(outputs)
    assert {(m.explorer, m.model, m.seed): m.begun for m in comparison.missing} == {
        (DEUX, KBNET, 1): False,
        (DEUX, VOICED, 0): False,
        (DEUX, VOICED, 1): False,
        (RANDOM, KBNET, 0): True,
        (RANDOM, KBNET, 1): False,
        (RANDOM, VOICED, 0): False,
    }


def test_missing_is_also_what_the_sweep_was_asked_for(write_run, write_sweep, outputs):
    write_sweep(["experiment=table1"], {"random_seed": "0,1", "model": "kbnet", "explore": "random,deux"})
    write_run("random", "kbnet", 0, 10.0)
    (comparison,) = compare(outputs)
    assert [(m.explorer[0], m.seed) for m in comparison.missing] == [("deux", 0), ("deux", 1), ("random", 1)]


def test_a_finished_grid_misses_nothing(write_run, write_sweep, outputs):
    write_sweep(["explore=random,deux", "random_seed=0,1"])
    for seed in range(2):
        write_run("random", "kbnet", seed, 10.0)
        write_run("deux", "kbnet", seed, 10.0)
    (comparison,) = compare(outputs)
    assert comparison.missing == ()


def test_a_sweep_of_which_nothing_is_finished(write_run, write_sweep, outputs):
    write_run("random", "kbnet", 0, 10.0)
    write_sweep(["explore=random,deux"], folder="later")
    assert [sweep.folder.name for sweep in lone_sweeps(find_runs(outputs), find_sweeps(outputs))] == ["later"]


def test_other_test_frames_are_noticed_by_the_baseline(write_run, outputs):
    write_run("random", "kbnet", 0, 10.0)
    path = write_run("deux", "kbnet", 0, 10.0) / "results.json"
    assert compare(outputs)[0].same_frames
    path.write_text(path.read_text().replace('"mae": 80.0', '"mae": 81.0'))
    assert not compare(outputs)[0].same_frames
