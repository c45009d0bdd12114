"""Active collection round by round: frames, area, uncertainty and validation error against training steps."""

from collections.abc import Sequence
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from deux.figures.drawing import new_figure
from deux.figures.training_curve import read_log
from deux.training.rounds import Round

_PANELS = {
    "frames": "frames of the round",
    "area": "area seen [m²]",
    "uncertainty": "mean uncertainty",
    "mae": "validation MAE [mm]",
}


def draw_rounds(rounds: Sequence[Round], logs: Path) -> Figure:
    """Draw what each round brought.

    Args:
        rounds: the rounds so far.
        logs: folder of the training's CSV logs; the validation error between the rounds is drawn from it.
    """
    figure = new_figure(13.0, 3.2)
    panels: dict[str, Axes] = dict(zip(_PANELS, figure.subplots(1, len(_PANELS)), strict=True))
    for name, axes in panels.items():
        known = [(one.step, getattr(one, name)) for one in rounds if getattr(one, name) is not None]
        if name == "mae":
            axes.plot(*read_log(logs).get("validation/mae", ([], [])), linewidth=1.0, color="0.6", label="training")
        axes.plot(*zip(*known, strict=True) if known else ([], []), "o-", linewidth=1.4, label="exploring model")
        axes.set_title(_PANELS[name], fontsize=10)
        axes.set_xlabel("step")
        axes.set_ylim(0, 1.1 * axes.dataLim.y1 if axes.dataLim.y1 > 0 else 1)
        axes.grid(alpha=0.3)
    panels["mae"].legend(fontsize=8)
    return figure
