"""A learned explorer's reward and the area that it sees, against training steps."""

from collections.abc import Sequence

from matplotlib.figure import Figure

from deux.figures.drawing import new_figure


def draw_learning_curve(steps: Sequence[int], reward: Sequence[float], area: Sequence[float], title: str) -> Figure:
    """Draw a learning curve.

    Args:
        steps: training steps of all environments.
        reward: sum of an episode's rewards, a mean over the latest episodes.
        area: square metres of the map that an episode knew at its end, likewise.
        title: of the reward's panel.
    """
    figure = new_figure(9.0, 3.4)
    panels = figure.subplots(1, 2)
    for axes, values, name in zip(
        panels, (reward, area), (f"{title}, sum of an episode", "area seen [m²]"), strict=True
    ):
        axes.plot(steps, values, linewidth=1.4)
        axes.set_title(name, fontsize=10)
        axes.set_xlabel("step")
        axes.grid(alpha=0.3)
    return figure
