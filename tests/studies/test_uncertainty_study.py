import csv
import io
from dataclasses import replace

import numpy as np
import pytest
from evaluated_walks import walk

from deux.studies.uncertainty_study import UncertaintyStudy

MEASURES = ("l1", "parallax", "flip", "sparse_error")
SCENES = (("a", 1.0, 0.6), ("b", -1.0, 0.8))


def test_numbers_are_means_over_scenes_with_their_interval(study):
    pixels = study.pixels("sparse_error")
    assert pixels.mean == pytest.approx(0.7)
    assert pixels.half_width == pytest.approx(12.706 * 0.1, rel=1e-3)  # Student's t for two scenes, 1 degree of freedom
    assert study.ause("sparse_error").mean == pytest.approx(0.15)
    assert study.frames("sparse_error").mean == pytest.approx(1.0)
    assert study.places("sparse_error").mean == pytest.approx(1.0)


def test_what_a_measure_goes_with(study):
    assert study.frames("l1", "moved").mean > 0.8
    assert study.frames("l1", "error").mean < 0.5
    assert study.frames("l1", "distance").mean == 0.0  # the same in all frames


def test_frames_for_which_a_measure_has_no_value(study):
    assert study.count() == 20
    assert study.count("moved") == 10
    assert study.coverage("parallax").mean == pytest.approx(0.25)  # half of the pixels of half of the frames
    assert study.coverage("parallax", "moved").mean == pytest.approx(0.5)
    assert study.frames("parallax").mean == pytest.approx(1.0)
    assert np.isnan(study.pixels("flip").mean)
    assert study.summary()["flip"]["rank_correlation_pixels"] is None
    assert np.isnan(study.frames("flip").mean)  # and no correlation of 0
    assert np.isnan(study.places("flip").mean)


def test_a_walk_of_which_a_number_is_not_known_does_not_count_in_it(study):
    """Of one frame there is no correlation: without one in which the camera moved, and with the only one of all."""
    frames = study.walks[1].frames
    for kept in (frames[:2], frames[1:2], frames[:1]):
        other = UncertaintyStudy([study.walks[0], replace(study.walks[1], frames=kept, places={})], MEASURES)
        for found in (other.frames("sparse_error", selection="moved"), other.places("sparse_error")):
            assert found.mean == pytest.approx(1.0)
            assert np.isnan(found.half_width)


def test_the_floors_of_a_scene_are_averaged_first():
    """Two scenes whose floors agree far better with one another than the scenes do."""
    floors = [walk(scene, sign, rank, floor) for scene, sign, rank in SCENES for floor in range(4)]
    one_each = [walk(scene, sign, rank) for scene, sign, rank in SCENES]
    found, expected = UncertaintyStudy(floors, MEASURES), UncertaintyStudy(one_each, MEASURES)
    assert found.scenes == expected.scenes == ("a", "b")
    for number in ("coverage", "pixels", "ause", "frames", "places"):
        assert getattr(found, number)("sparse_error") == pytest.approx(getattr(expected, number)("sparse_error"))
    rows = list(csv.DictReader(io.StringIO(found.frames_csv())))
    assert {(row["scene"], row["floor"]) for row in rows} == {(s, str(f)) for s in "ab" for f in range(4)}


def test_each_scene_counts_alike_however_many_floors_it_has():
    uneven = UncertaintyStudy([walk("a", 1.0, 0.4), walk("b", 1.0, 0.7), walk("b", 1.0, 0.9, 1)], MEASURES)
    assert uneven.pixels("sparse_error").mean == pytest.approx(0.6)
