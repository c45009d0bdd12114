import numpy as np
import pytest

from deux.studies.judged_scene import JudgedFrame, JudgedScene, Judgement, Place
from deux.studies.uncertainty_figures import (
    JudgedSample,
    draw_frames,
    draw_sparsification,
    draw_uncertainty_maps,
)
from deux.studies.uncertainty_study import UncertaintyStudy


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
    return UncertaintyStudy([scene("a", 1.0, 0.6), scene("b", 1.0, 0.8)], ("l1", "sparse_error", "parallax", "flip"))


def test_figures_show_the_measures_that_say_something(study):
    figure = draw_sparsification(study)
    assert len(figure.axes) == 2
    labels = [line.get_label() for line in figure.axes[0].lines]
    assert "sparse_error (0.15)" in labels
    assert "the error itself" in labels
    assert not any(str(label).startswith("flip") for label in labels)


def test_each_measure_has_a_panel_with_a_point_for_each_of_its_frames(study):
    axes = draw_frames(study).axes
    drawn = [sum(len(group.get_offsets()) for group in panel.collections) for panel in axes if panel.axison]
    assert drawn == [20, 20, 10, 0]  # l1, sparse_error, parallax (where the camera moved), flip
    assert [panel.get_title().partition(":")[0] for panel in axes[:4]] == ["l1", "sparse_error", "parallax", "flip"]


def test_maps_have_a_column_for_each_measure_and_a_scale_of_its_own():
    rgb = np.zeros((4, 6, 3), np.uint8)
    error = np.full((4, 6), 0.5)
    error[0] = np.nan
    maps = {"l1": np.full((4, 6), 0.1), "flip": np.full((4, 6), np.nan), "chance": np.ones((4, 6))}
    figure = draw_uncertainty_maps([JudgedSample(rgb, error, maps)] * 2)
    titles = [axes.get_title() for axes in figure.axes[:4]]
    assert titles == ["image", "true error\n0 to 0.5", "l1\n0 to 0.1", "flip\n0 to 1"]
    assert len(figure.axes) == 8
