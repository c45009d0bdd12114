"""Training curves of depth models, of rounds of active collection, and of learned explorers."""

import math
from collections.abc import Sequence
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from deux.errors import DeuxError
from deux.figures.drawing import new_figure
from deux.io.csv_files import number, read_table
from deux.metrics.depth_errors import METRICS
from deux.training.rounds import Round

_ROUND_PANELS = {
    "frames": "frames of the round",
    "area": "area seen [m²]",
    "uncertainty": "mean uncertainty",
    "mae": f"validation {METRICS['mae'].heading}",
}
"""Plotted attributes of a round with the titles of their panels."""


def read_log(folder: Path) -> dict[str, tuple[list[int], list[float]]]:
    """Read the steps and values of each logged quantity.

    Args:
        folder: folder with `version_<n>/metrics.csv` for each start of the training. Entries that were logged after the
            checkpoint from which the next start resumed are ignored.
    """
    logs = [path for path in folder.glob("version_*/metrics.csv") if path.parent.name[len("version_") :].isdecimal()]
    logs.sort(key=lambda path: int(path.parent.name[len("version_") :]))
    series: dict[str, dict[int, float]] = {}
    for log in logs:
        rows = read_table(log)
        if not rows:  # the process was killed before its first entry
            continue
        if "step" not in rows[0]:
            raise DeuxError(f"{log} is damaged: it has no column step.")
        steps = [number(row, "step", log) for row in rows]
        first = min(steps)
        for name, known in series.items():
            series[name] = {step: value for step, value in known.items() if step < first}
        for step, row in zip(steps, rows, strict=True):
            for name, value in row.items():
                if value and name not in ("", "step", "epoch") and math.isfinite(step):
                    series.setdefault(name, {})[int(step)] = number(row, name, log)
    return {name: (list(known), list(known.values())) for name, known in series.items()}


def draw_training_curve(folder: Path) -> Figure:
    """Draw the training loss with its terms, and the validation MAE, from the logs of a training."""
    series = read_log(folder)
    figure = new_figure(10.0, 3.6)
    terms, error = figure.subplots(1, 2)
    for name in sorted(series):
        if name.startswith("train/") and name not in ("train/learning_rate", "train/photometric_error"):
            terms.plot(*series[name], label=name.removeprefix("train/"), linewidth=1.2)
    _label(terms, "training loss (terms unweighted)", logarithmic=True)
    if "validation/mae" in series:
        error.plot(*series["validation/mae"], marker="o", markersize=3, label="held-out frames")
    _label(error, f"validation {METRICS['mae'].heading}", logarithmic=False)
    return figure


def draw_rounds(rounds: Sequence[Round], logs: Path) -> Figure:
    """Draw the rounds of active collection: frames, area, uncertainty and validation error of each.

    Args:
        rounds: the finished rounds.
        logs: folder of the training's CSV logs, which contain the validation error between rounds.
    """
    figure = new_figure(13.0, 3.2)
    panels: dict[str, Axes] = dict(zip(_ROUND_PANELS, figure.subplots(1, len(_ROUND_PANELS)), strict=True))
    for name, axes in panels.items():
        known = [(one.step, getattr(one, name)) for one in rounds if getattr(one, name) is not None]
        if name == "mae":
            axes.plot(*read_log(logs).get("validation/mae", ([], [])), linewidth=1.0, color="0.6", label="training")
        axes.plot(*zip(*known, strict=True) if known else ([], []), "o-", linewidth=1.4, label="exploring model")
        axes.set_title(_ROUND_PANELS[name], fontsize=10)
        axes.set_xlabel("step")
        axes.set_ylim(0, 1.1 * axes.dataLim.y1 if axes.dataLim.y1 > 0 else 1)
        axes.grid(alpha=0.3)
    panels["mae"].legend(fontsize=8)
    return figure


def draw_learning_curve(steps: Sequence[int], reward: Sequence[float], area: Sequence[float], title: str) -> Figure:
    """Draw the reward and the explored area of a learned explorer.

    Args:
        steps: training steps of all environments.
        reward: sum of the rewards of an episode, averaged over the latest episodes.
        area: known area of the map at the end of an episode in square metres, averaged likewise.
        title: title of the reward panel.
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


def _label(axes: Axes, title: str, logarithmic: bool) -> None:
    axes.set_title(title, fontsize=10)
    axes.set_xlabel("step")
    axes.grid(alpha=0.3)
    if axes.lines:
        axes.legend(fontsize=8)
        axes.set_yscale("log" if logarithmic else "linear")
