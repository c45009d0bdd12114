"""`results.json`: what a run found, in numbers."""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from rich.table import Table

from deux.errors import DeuxError
from deux.io.atomic import write_json
from deux.metrics.depth_errors import METRIC_NAMES

RESULTS_FILE = "results.json"

IDENTITY_FILE = "run.json"
"""The whole configuration of a run, in its folder from its beginning on."""

_UNITS = {"mae": "mm", "rmse": "mm", "imae": "1/km", "irmse": "1/km"}


@dataclass(frozen=True)
class Results:
    """One run's outcome on the test frames.

    Args:
        model: name of the depth model.
        explore: name of the explorer that collected the training frames; None if the model was given.
        seed: the run's random seed.
        frames: number of training frames, those of all rounds included; None if the model was given.
        metrics: the trained model's four errors.
        baseline: the same for linear interpolation of the sparse points, on the same frames.
        constant: the same for the median of each frame's sparse points.
        seconds: time spent in each stage.
        trained: of a given model, where it comes from: `weights`, a digest of its file, and `settings`, the identity
            (`run.json`) of the run that trained it, None if it is not known; None for a model of the run's own.
        rounds: of active collection, each with round, step, frames, area, uncertainty and mae
            (`deux.training.rounds.Round`); none without it.
    """

    model: str
    explore: str | None
    seed: int
    frames: int | None
    metrics: dict[str, float]
    baseline: dict[str, float]
    constant: dict[str, float]
    seconds: dict[str, float]
    trained: dict[str, Any] | None = None
    rounds: list[dict[str, Any]] = field(default_factory=list)

    def save(self, folder: Path) -> Path:
        """Write `results.json` into a run folder, whole or not at all."""
        path = folder / RESULTS_FILE
        write_json(path, asdict(self))
        return path

    @classmethod
    def load(cls, folder: Path) -> "Results":
        """Read a run folder's `results.json`.

        Raises:
            DeuxError: it is missing or not what `save` writes.
        """
        path = folder / RESULTS_FILE
        try:
            results = cls(**json.loads(path.read_text()))
            for errors in (results.metrics, results.baseline, results.constant):
                _check_errors(errors)
            return results
        except FileNotFoundError:
            raise DeuxError(f"{path} does not exist: {folder} holds no finished run.") from None
        except (OSError, ValueError, TypeError) as error:
            raise DeuxError(f"{path} is no results file of deux ({error}); run it again.") from None

    def table(self) -> Table:
        """The errors as a table, the lowest of each column in bold."""
        rows = {
            f"{self.model}{f', {self.explore} frames' if self.explore else ''}": self.metrics,
            "interpolated points": self.baseline,
            "median of the points": self.constant,
        }
        training = "" if self.frames is None else f" ({self.frames} training frames, seed {self.seed})"
        return error_table(f"Errors on the test frames{training}", rows)


def _check_errors(errors: object) -> None:
    """Raise ValueError unless there are four numbers; NaN is one."""
    for name in METRIC_NAMES:
        if not isinstance(errors, dict) or type(errors.get(name)) not in (int, float):
            raise ValueError(f"it has no number for {name}")


def error_table(title: str, rows: Mapping[str, Mapping[str, float]]) -> Table:
    """The four errors of each row as a table, the lowest of each column in bold."""
    table = Table(title=title)
    table.add_column("prediction")
    for name in METRIC_NAMES:
        table.add_column(f"{name} \\[{_UNITS[name]}]", justify="right")
    best = {name: min(row[name] for row in rows.values()) for name in METRIC_NAMES}
    for prediction, row in rows.items():
        marks = ["[bold]{}[/bold]" if row[name] == best[name] else "{}" for name in METRIC_NAMES]
        cells = [mark.format(f"{row[name]:.1f}") for mark, name in zip(marks, METRIC_NAMES, strict=True)]
        table.add_row(prediction, *cells)
    return table
