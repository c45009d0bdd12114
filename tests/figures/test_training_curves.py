import math

import numpy as np
import pytest

from deux.figures.drawing import save_figure
from deux.figures.training_curves import draw_learning_curve, draw_rounds, draw_training_curve, read_log
from deux.training.rounds import Round


def test_training_curve_joins_the_logs_of_a_run_that_was_killed(tmp_path):
    for version, text in enumerate(
        (
            "epoch,step,train/loss,validation/mae\n0,9,2.5,\n0,19,1.5,\n0,19,,300\n1,29,9.0,\n",
            "epoch,step,train/loss,validation/mae\n1,29,1.0,\n1,39,,200\n",
        )
    ):
        (tmp_path / f"version_{version}").mkdir()
        (tmp_path / f"version_{version}" / "metrics.csv").write_text(text)
    losses, errors = draw_training_curve(tmp_path).axes
    assert losses.lines[0].get_xydata().tolist() == [[9, 2.5], [19, 1.5], [29, 1.0]]
    assert errors.lines[0].get_xydata().tolist() == [[19, 300.0], [39, 200.0]]


@pytest.mark.parametrize("text", ["", "epoch,step,train/loss\n"])
def test_a_start_that_was_killed_before_it_logged_anything_changes_nothing(tmp_path, text):
    for version, content in enumerate((text, "epoch,step,train/loss\n0,10,1.0\n0,20,0.9\n", text)):
        (tmp_path / f"version_{version}").mkdir()
        (tmp_path / f"version_{version}" / "metrics.csv").write_text(content)
    assert read_log(tmp_path) == {"train/loss": ([10, 20], [1.0, 0.9])}


def test_an_infinite_validation_error_can_be_drawn(tmp_path):
    """What `DepthErrors` gives for a network that predicts no depth any more."""
    (tmp_path / "version_0").mkdir()
    (tmp_path / "version_0" / "metrics.csv").write_text("epoch,step,validation/mae\n0,9,300\n1,19,inf\n2,29,200\n")
    figure = draw_training_curve(tmp_path)
    assert figure.axes[1].lines[0].get_ydata().tolist() == [300.0, math.inf, 200.0]
    save_figure(figure, tmp_path / "training.png")
    rounds = [Round(1, 10, 24, 8.5, 0.02, math.inf, []), Round(2, 30, 20, 6.5, 0.03, 250.0, [])]
    figure = draw_rounds(rounds, tmp_path)
    assert 300.0 < figure.axes[3].get_ylim()[1] < 400.0
    save_figure(figure, tmp_path / "rounds.png")


def logs(folder):
    (folder / "version_0").mkdir()
    (folder / "version_0" / "metrics.csv").write_text(
        "epoch,step,rounds/mae,validation/mae\n0,9,,300\n,10,310,\n1,19,,200\n"
    )
    return folder


def test_each_panel_shows_one_quantity_against_steps(tmp_path):
    rounds = [Round(1, 10, 24, 8.5, 0.02, 310.0, []), Round(2, 30, 20, 6.5, 0.03, 250.0, [])]
    frames, area, uncertainty, error = draw_rounds(rounds, logs(tmp_path)).axes
    assert frames.lines[0].get_xydata().tolist() == [[10, 24], [30, 20]]
    assert area.lines[0].get_xydata().tolist() == [[10, 8.5], [30, 6.5]]
    assert uncertainty.lines[0].get_xydata().tolist() == [[10, 0.02], [30, 0.03]]
    assert error.lines[0].get_xydata().tolist() == [[9, 300], [19, 200]]
    assert error.lines[1].get_xydata().tolist() == [[10, 310], [30, 250]]


def test_what_is_not_known_is_not_drawn(tmp_path):
    figure = draw_rounds([Round(1, 10, 24, 8.5, None, None, [])], tmp_path)
    assert [len(axes.lines[-1].get_xydata()) for axes in figure.axes] == [1, 1, 0, 0]
    save_figure(figure, tmp_path / "rounds.png")


def test_both_curves_are_drawn_against_the_steps():
    steps, reward, area = [10, 20, 30], [1.0, 4.0, 2.0], [5.0, 6.0, 7.0]
    panels = draw_learning_curve(steps, reward, area, "novelty").axes
    for axes, values in zip(panels, (reward, area), strict=True):
        np.testing.assert_array_equal(axes.lines[0].get_xydata(), np.column_stack([steps, values]))
    assert panels[0].get_title().startswith("novelty")


def test_a_training_without_a_whole_episode_can_be_drawn():
    assert len(draw_learning_curve([], [], [], "novelty").axes) == 2
