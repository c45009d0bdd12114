import numpy as np

from deux.studies.uncertainty_figures import (
    EvaluatedSample,
    draw_frames,
    draw_sparsification,
    draw_uncertainty_maps,
)
from deux.studies.uncertainty_study import UncertaintyStudy


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
    assert axes[3].get_title() == "flip: no rank correlation"


def test_the_legend_names_what_any_panel_shows(study):

    figure = draw_frames(UncertaintyStudy(study.walks, ("parallax", "sparse_error")))
    assert [text.get_text() for text in figure.axes[0].get_legend().get_texts()] == [
        "the camera moved",
        "it turned only",
    ]


def test_maps_have_a_column_for_each_measure_and_a_scale_of_its_own():
    rgb = np.zeros((4, 6, 3), np.uint8)
    error = np.full((4, 6), 0.5)
    error[0] = np.nan
    maps = {"l1": np.full((4, 6), 0.1), "flip": np.full((4, 6), np.nan), "chance": np.ones((4, 6))}
    figure = draw_uncertainty_maps([EvaluatedSample(rgb, error, maps)] * 2)
    titles = [axes.get_title() for axes in figure.axes[:4]]
    assert titles == ["image", "true error\n0 to 0.5", "l1\n0 to 0.1", "flip\n0 to 1"]
    assert len(figure.axes) == 8
