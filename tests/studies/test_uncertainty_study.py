import numpy as np
import pytest

from deux.studies.judged_scene import JudgedFrame, JudgedScene, Judgement, Place
from deux.studies.uncertainty_study import UncertaintyStudy

MEASURES = ("l1", "parallax", "flip", "sparse_error")


def judgement(delta: float, rank: float) -> Judgement:
    oracle = np.linspace(1.0, 0.05, 20)
    return Judgement(delta, 0.5, rank, (1.0 - rank) / 2.0, (rank * oracle + (1.0 - rank)).tolist(), oracle.tolist())


def scene(name: str, sign: float, rank: float) -> JudgedScene:
    """Ten frames whose l1 goes with the motion, and whose sparse_error goes with the error (or against it)."""
    rng = np.random.default_rng(0)
    frames = [
        JudgedFrame(
            step=step,
            moved=(moved := 0.5 * (step % 2)),
            turned=10.0,
            distance=2.0,
            texture=0.1,
            error=(error := 100.0 + 10.0 * step),
            judgements={
                "l1": judgement(moved + 0.01 * rng.random(), 0.1),
                "sparse_error": judgement(sign * error, rank),
                **({"parallax": judgement(error, 0.3)} if moved else {}),
                "chance": judgement(rng.random(), 0.0),
            },
        )
        for step in range(10)
    ]
    places = [Place(uncertainty=float(i), error=float(i * i)) for i in range(5)]
    return JudgedScene(name, frames, {"l1": places[::-1], "sparse_error": places})


@pytest.fixture
def study() -> UncertaintyStudy:
    return UncertaintyStudy([scene("a", 1.0, 0.6), scene("b", 1.0, 0.8)], MEASURES)


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
