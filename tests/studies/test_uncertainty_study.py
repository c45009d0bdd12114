import numpy as np
import pytest

MEASURES = ("l1", "parallax", "flip", "sparse_error")


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


def test_frames_of_which_a_measure_says_nothing(study):
    assert study.count() == 20
    assert study.count("moved") == 10
    assert study.coverage("parallax").mean == pytest.approx(0.25)  # half of the pixels of half of the frames
    assert study.coverage("parallax", "moved").mean == pytest.approx(0.5)
    assert study.frames("parallax").mean == pytest.approx(1.0)
    assert np.isnan(study.pixels("flip").mean)
    assert study.summary()["flip"]["rank_correlation_pixels"] is None
