import numpy as np

from deux.figures.learning_curve import draw_learning_curve


def test_both_curves_are_drawn_against_the_steps():
    steps, reward, area = [10, 20, 30], [1.0, 4.0, 2.0], [5.0, 6.0, 7.0]
    panels = draw_learning_curve(steps, reward, area, "novelty").axes
    for axes, values in zip(panels, (reward, area), strict=True):
        np.testing.assert_array_equal(axes.lines[0].get_xydata(), np.column_stack([steps, values]))
    assert panels[0].get_title().startswith("novelty")


def test_a_training_without_a_whole_episode_can_be_drawn():
    assert len(draw_learning_curve([], [], [], "novelty").axes) == 2
