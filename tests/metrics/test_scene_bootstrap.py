import math

import numpy as np
import pytest

from deux.metrics.intervals import estimate
from deux.metrics.scene_bootstrap import SceneValue, scene_estimate


def seeds_of(values: np.ndarray, shared: bool = False) -> list[dict[str, SceneValue]]:
    """Seeds x scenes as scenes of equal weight, of other names for each seed unless shared."""
    return [
        {f"{0 if shared else seed}-{scene:02d}": SceneValue(float(value), 40) for scene, value in enumerate(row)}
        for seed, row in enumerate(values)
    ]


def test_with_one_scene_a_seed_it_is_students_interval():
    """Beyond n = 30 the percentiles of the resampled means and Student's t agree but for the n / (n - 1)."""
    values = np.random.default_rng(0).normal(3.0, 2.0, (60, 1))
    found, expected = scene_estimate(seeds_of(values)), estimate(values[:, 0].tolist())
    assert found.mean == pytest.approx(expected.mean)
    assert found.half_width == pytest.approx(expected.half_width, rel=0.05)


def test_where_scenes_make_the_spread_it_holds_the_effect_as_often_as_its_level():
    rng, effect = np.random.default_rng(1), -5.0
    held = [
        abs(found.mean - effect) <= found.half_width
        for found in (scene_estimate(seeds_of(rng.normal(effect, 20.0, (5, 16)))) for _ in range(100))
    ]
    assert 0.92 <= np.mean(held) <= 1.0


def test_it_is_narrower_than_students_where_scenes_make_the_spread():
    rng = np.random.default_rng(2)
    drawn = [rng.normal(0.0, 20.0, (3, 16)) for _ in range(60)]
    ours = np.mean([scene_estimate(seeds_of(values)).half_width for values in drawn])
    students = np.mean([estimate(values.mean(axis=1).tolist()).half_width for values in drawn])
    assert ours < 0.8 * students


def test_scenes_that_all_seeds_share_do_not_average_out():
    """Of the crossed design the scenes' part of the variance is that of one seed, not of three."""
    scenes = np.random.default_rng(3).normal(0.0, 10.0, 16)
    values = np.tile(scenes, (3, 1))
    crossed = scene_estimate(seeds_of(values, shared=True)).half_width
    nested = scene_estimate(seeds_of(values)).half_width
    assert crossed == pytest.approx(1.96 * scenes.std() / 4, rel=0.08)
    assert nested < 0.7 * crossed


def test_scenes_count_by_their_frames():
    one = {"a": SceneValue(1.0, 30), "b": SceneValue(5.0, 10)}
    assert scene_estimate([one, one]).mean == pytest.approx(2.0)


def test_no_interval_without_two_seeds_and_no_mean_without_scenes():
    one = {"a": SceneValue(1.0, 1)}
    assert scene_estimate([one]).mean == 1.0
    assert math.isnan(scene_estimate([one]).half_width)
    assert math.isnan(scene_estimate([one, {}]).mean)
    assert math.isnan(scene_estimate([]).mean)
