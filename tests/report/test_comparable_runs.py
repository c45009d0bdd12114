import json

import pytest
from scipy import stats

from deux.errors import DeuxError
from deux.report.comparable_runs import group_comparable
from deux.report.display_names import Variant
from deux.report.runs import find_runs
from deux.report.sweeps import find_sweeps

DEUX, RANDOM, KBNET, VOICED = Variant("deux"), Variant("random"), Variant("kbnet"), Variant("voiced")


def compare(outputs):
    return group_comparable(find_runs(outputs), find_sweeps(outputs))


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
    assert [len(runs.finished) for runs in found] == [4, 1, 1, 1, 1, 1]
    assert [runs.transferred for runs in found].count(True) == 1


def test_seeds_are_summed_up_cell_by_cell(write_run, outputs):
    values = {0: 10.0, 1: 14.0, 2: 11.0}
    for seed, mae in values.items():
        write_run("deux", "kbnet", seed, mae)
    (runs,) = compare(outputs)
    errors = runs.errors(DEUX, KBNET)
    half = stats.t.ppf(0.975, 2) * stats.sem(list(values.values()))
    assert errors.seeds == (0, 1, 2)
    assert errors.estimates["mae"] == (pytest.approx(35 / 3), pytest.approx(half))
    assert errors.estimates["rmse"].mean == pytest.approx(70 / 3)
    assert errors.estimates["imae"].mean == pytest.approx(35.0)
    assert errors.estimates["irmse"].mean == pytest.approx(1000 - 35 / 3)
    assert runs.errors(RANDOM, KBNET) is None
    assert [one.mean for one in runs.baseline.estimates.values()] == [80.0, 180.0, 70.0, 150.0]
    assert runs.baseline.seeds == ()


def test_the_difference_of_two_explorers_is_taken_seed_by_seed(write_run, outputs):
    """What a seed does to both, here 20 mm to and fro, is in neither the difference nor its interval."""
    gains = [5.0, 4.0, 6.0]
    for seed, (common, gain) in enumerate(zip((30.0, 50.0, 40.0), gains, strict=True)):
        write_run("random", "kbnet", seed, common)
        write_run("deux", "kbnet", seed, common - gain)
    write_run("novelty", "kbnet", 0, 10.0)
    (runs,) = compare(outputs)
    reference = stats.ttest_1samp([-gain for gain in gains], 0.0).confidence_interval(0.95)
    found = runs.paired_difference(DEUX, RANDOM, KBNET)
    assert (found.mean - found.half_width, found.mean + found.half_width) == pytest.approx(tuple(reference))
    assert runs.paired_difference(Variant("novelty"), RANDOM, KBNET) is None
    assert runs.paired_difference(DEUX, RANDOM, VOICED) is None


def test_variants_of_an_explorer_are_rows_of_their_own(write_run, outputs):
    write_run("deux", "kbnet", 0, 10.0)
    write_run("deux", "kbnet", 0, 20.0, folder="other", explore__residual_pose="surface")
    (runs,) = compare(outputs)
    assert runs.explorers == {Variant("deux", "residual_pose not set"), Variant("deux", "residual_pose=surface")}


def test_a_run_that_is_there_twice_counts_once(write_run, outputs):
    write_run("deux", "kbnet", 0, 10.0)
    write_run("deux", "kbnet", 0, 10.001, folder="copy")
    (runs,) = compare(outputs)
    assert (runs.duplicates, runs.errors(DEUX, KBNET).estimates["mae"].mean) == (1, 10.001)  # the first folder by name


def test_the_same_run_with_other_errors_is_a_mistake(write_run, outputs):
    write_run("deux", "kbnet", 0, 10.0)
    write_run("deux", "kbnet", 0, 20.0, folder="again")
    with pytest.raises(
        DeuxError, match=r"again/\S+ and \S+ are the same run with different errors \(MAE 20.0 and 10.0 mm\)"
    ):
        compare(outputs)


def test_a_begun_run_that_was_finished_elsewhere_is_not_missing(write_run, outputs):
    write_run("deux", "kbnet", 0, None, folder="stopped")
    write_run("deux", "kbnet", 0, 20.0)
    (runs,) = compare(outputs)
    assert (runs.missing, len(runs.finished)) == ((), 1)


def test_missing_is_what_the_occurring_values_call_for(write_run, outputs):
    write_run("deux", "kbnet", 0, 10.0)
    write_run("random", "voiced", 1, 10.0)
    write_run("random", "kbnet", 0, None)
    (runs,) = compare(outputs)
    assert {(m.explorer, m.model, m.seed): m.started for m in runs.missing} == {
        (DEUX, KBNET, 1): False,
        (DEUX, VOICED, 0): False,
        (DEUX, VOICED, 1): False,
        (RANDOM, KBNET, 0): True,
        (RANDOM, KBNET, 1): False,
        (RANDOM, VOICED, 0): False,
    }


def test_missing_is_also_what_the_sweep_was_asked_for(write_run, write_sweep, outputs):
    write_sweep(["experiment=table1"], {"seed": "0,1", "model": "kbnet", "explore": "random,deux"})
    write_run("random", "kbnet", 0, 10.0)
    (runs,) = compare(outputs)
    assert [(m.explorer.name, m.seed) for m in runs.missing] == [("deux", 0), ("deux", 1), ("random", 1)]


def test_a_sweep_over_checkpoints_asks_for_the_models_that_they_hold(write_run, write_sweep, outputs):
    write_sweep(["task=evaluate", "evaluation.checkpoint=a,b"], task="evaluate")
    write_run("random", "voiced", 0, 10.0)
    (runs,) = compare(outputs)
    assert runs.missing == ()


def test_a_preset_that_was_swept_over_is_not_missing(write_run, write_sweep, outputs):
    """The runs of explore=deux_paper say explore.name=deux and the preset's options."""
    write_sweep(["explore=random,deux_paper", "seed=0,1"])
    for seed in range(2):
        write_run("random", "kbnet", seed, 10.0)
    write_run("deux", "kbnet", 0, 10.0, explore__guidance=1.0)
    presets = {"deux_paper": (("explore.guidance", "1"),)}
    (runs,) = group_comparable(find_runs(outputs), find_sweeps(outputs), presets)
    assert [(m.explorer.name, m.seed) for m in runs.missing] == [("deux", 1)]


def test_a_finished_grid_misses_nothing(write_run, write_sweep, outputs):
    write_sweep(["explore=random,deux", "seed=0,1"])
    for seed in range(2):
        write_run("random", "kbnet", seed, 10.0)
        write_run("deux", "kbnet", seed, 10.0)
    (runs,) = compare(outputs)
    assert runs.missing == ()


def test_other_test_frames_are_noticed_by_the_baseline(write_run, outputs):
    write_run("random", "kbnet", 0, 10.0)
    path = write_run("deux", "kbnet", 0, 10.0) / "results.json"
    assert compare(outputs)[0].same_frames
    path.write_text(path.read_text().replace('"mae": 80.0', '"mae": 81.0'))
    assert not compare(outputs)[0].same_frames


def test_runs_of_an_older_version_stand_beside_those_of_this_one(write_run, outputs):
    write_run("deux", "kbnet", 0, 10.0, explore__target="sampled")  # the only targets that version 0.1.0 had
    path = write_run("deux", "kbnet", 1, 14.0) / "run.json"
    configuration = json.loads(path.read_text())
    configuration["random_seed"] = configuration.pop("seed")
    configuration["scenes"]["source"] = configuration["scenes"].pop("name")
    configuration["image"] = configuration["checkpoint"] = None
    path.write_text(json.dumps(configuration))
    (runs,) = compare(outputs)
    (deux,) = runs.explorers
    assert runs.errors(deux, KBNET).seeds == (0, 1)


def drawn(here, seed, draw=None):
    return {**here, "scenes": {**here["scenes"], "draw": seed if draw is None else draw}}


def test_a_draw_that_the_command_names_is_the_same_for_all_seeds(write_run, outputs, here):
    """Also where it equals one of them."""
    for seed in range(3):
        named = ("scenes.draw=0", f"seed={seed}")
        write_run("deux", "kbnet", seed, 100.0, place=drawn(here, seed, draw=0), overrides=named)
    (runs,) = compare(outputs)
    assert len(runs.finished) == 3


def with_results(path, **changes):
    file = path / "results.json"
    file.write_text(json.dumps({**json.loads(file.read_text()), **changes}))


def test_seeds_with_scenes_of_their_own_stand_in_one_table(write_run, outputs, here):
    """Interpolation errs as the seed's scenes make it, in the runs of one seed alike."""
    base = {"rmse": 180.0, "imae": 70.0, "irmse": 150.0}
    for seed, mae in enumerate((80.0, 90.0, 100.0)):
        for explorer in ("deux", "random"):
            path = write_run(explorer, "kbnet", seed, 10.0 + seed, place=drawn(here, seed))
            with_results(path, baseline={**base, "mae": mae})
    (runs,) = compare(outputs)
    assert (runs.drawn_by_seed, runs.same_frames, runs.baseline.seeds) == (True, True, (0, 1, 2))
    expected = (90.0, pytest.approx(stats.t.ppf(0.975, 2) * stats.sem([80.0, 90.0, 100.0])))
    assert runs.baseline.estimates["mae"] == expected
    with_results(path, baseline={**base, "mae": 101.0})
    assert not compare(outputs)[0].same_frames


def test_runs_in_the_same_scenes_for_every_seed_stand_apart(write_run, outputs, here):
    for seed in (0, 1):
        write_run("deux", "kbnet", seed, 10.0, folder="fixed")
        write_run("deux", "kbnet", seed, 10.0, place=drawn(here, seed))
    assert sorted((runs.drawn_by_seed, len(runs.finished)) for runs in compare(outputs)) == [(False, 2), (True, 2)]


def test_a_model_that_is_tested_in_the_scenes_of_another_seed_is_no_run_of_its_own_test(write_run, outputs, here):
    for seed in (0, 1):
        write_run("deux", "kbnet", seed, 10.0, place=drawn(here, seed))
    write_run("deux", "kbnet", 1, 10.0, place=drawn(here, 1, draw=0), trained_in=drawn(here, 1))
    assert sorted((runs.transferred, len(runs.finished)) for runs in compare(outputs)) == [(False, 2), (True, 1)]


def scene_errors(seed, gain, floors=1):
    """Eight scenes of 40 frames, those with floors with as much to gain over all of them."""
    errors = {"rmse": 1.0, "imae": 1.0, "irmse": 1.0}
    shares = {1: [(40, 0)], 4: [(4, -2), (8, -1), (12, 0), (16, 1)]}[floors]  # frames, and what more is gained
    return [
        {
            "scene": f"s{seed}{k}" + (f"-floor{floor}" if floor else ""),
            "frames": frames,
            "metrics": {**errors, "mae": 100.0 + 50.0 * k - gain * (1 + k % 2 + more)},
            "baseline": {**errors, "mae": 1.0},
        }
        for k in range(8)
        for floor, (frames, more) in enumerate(shares)
    ]


def test_the_difference_by_scene_pairs_seed_and_scene(write_run, outputs, here):
    """Scenes differ by 50 mm in the errors and by 2 mm in the gain, which the interval is of."""
    for seed in range(2):
        for explorer, gain in (("random", 0.0), ("deux", 4.0)):
            path = write_run(explorer, "kbnet", seed, 100.0, place=drawn(here, seed))
            with_results(path, scenes=scene_errors(seed, gain))
    (runs,) = compare(outputs)
    found = runs.scene_difference(DEUX, RANDOM, KBNET)
    assert found.mean == pytest.approx(-6.0)
    assert 0.3 < found.half_width < 2.5
    with_results(path, scenes=[])
    assert compare(outputs)[0].scene_difference(DEUX, RANDOM, KBNET) is None


@pytest.mark.parametrize(("shared", "least"), [(False, 4), (True, 8)])
def test_of_few_scenes_there_is_no_interval(write_run, outputs, here, shared, least):
    for count in (least - 1, least):
        for seed in range(2):
            for explorer, gain in (("random", 0.0), ("deux", 4.0)):
                path = write_run(explorer, "kbnet", seed, 100.0, place=drawn(here, seed), folder=str(count))
                with_results(path, scenes=scene_errors(0 if shared else seed, gain)[:count])
        (runs,) = compare(outputs / str(count))
        assert (runs.scene_difference(DEUX, RANDOM, KBNET) is None) == (count < least)


def test_more_views_of_the_same_scenes_are_no_other_dataset(write_run, outputs, here):
    more = {**here, "evaluation": {"viewpoints": 99}}
    write_run("deux", "kbnet", 2, 10.0, place=more, trained_in=here)
    (runs,) = compare(outputs)
    assert not runs.transferred


def test_floors_of_a_scene_count_as_one_scene(write_run, outputs, here):
    """However many floors they have, eight scenes with equal means over their frames have one interval."""
    found = []
    for name, floors in (("whole", 1), ("floors", 4)):
        for seed in range(2):
            for explorer, gain in (("random", 0.0), ("deux", 4.0)):
                path = write_run(explorer, "kbnet", seed, 100.0, place=drawn(here, seed), folder=name)
                with_results(path, scenes=scene_errors(seed, gain, floors))
        (runs,) = compare(outputs / name)
        found.append(runs.scene_difference(DEUX, RANDOM, KBNET))
    assert found[0] == pytest.approx(found[1])
    assert found[0].half_width > 0.3
