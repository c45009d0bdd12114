"""Loss terms and validation error against training steps, read from Lightning's CSV log."""

import csv
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from deux.figures.drawing import new_figure


def read_log(folder: Path) -> dict[str, tuple[list[int], list[float]]]:
    """Each logged quantity: the steps at which it was logged, and its values.

    Args:
        folder: holds `version_<n>/metrics.csv`, one for each start of the training. What a killed start logged
            beyond the checkpoint from which the next one went on is left out.
    """
    logs = sorted(folder.glob("version_*/metrics.csv"), key=lambda path: int(path.parent.name.split("_")[1]))
    series: dict[str, dict[int, float]] = {}
    for log in logs:
        with log.open(newline="") as file:
            rows = list(csv.DictReader(file))
        first = min((int(row["step"]) for row in rows), default=0)
        for name, known in series.items():
            series[name] = {step: value for step, value in known.items() if step < first}
        for row in rows:
            for name, value in row.items():
                if value and name not in ("step", "epoch"):
                    series.setdefault(name, {})[int(row["step"])] = float(value)
    return {name: (list(known), list(known.values())) for name, known in series.items()}


def draw_training_curve(folder: Path) -> Figure:
    """Draw the training loss with its terms, and the validation MAE, from the logs that `fit` leaves in a folder."""
    series = read_log(folder)
    figure = new_figure(10.0, 3.6)
    terms, error = figure.subplots(1, 2)
    for name in sorted(series):
        if name.startswith("train/") and name not in ("train/learning_rate", "train/photometric_error"):
            terms.plot(*series[name], label=name.removeprefix("train/"), linewidth=1.2)
    _dress(terms, "training loss (terms unweighted)", logarithmic=True)
    if "validation/mae" in series:
        error.plot(*series["validation/mae"], marker="o", markersize=3, label="held-out flat")
    _dress(error, "validation MAE [mm]", logarithmic=False)
    return figure


def _dress(axes: Axes, title: str, logarithmic: bool) -> None:
    axes.set_title(title, fontsize=10)
    axes.set_xlabel("step")
    axes.grid(alpha=0.3)
    if axes.lines:
        axes.legend(fontsize=8)
        axes.set_yscale("log" if logarithmic else "linear")
