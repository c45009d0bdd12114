"""The results of a finished run: reading and writing `results.json`."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from deux.errors import DeuxError, counted, error_text, plural
from deux.io.atomic import write_json
from deux.io.json_files import read_record
from deux.metrics.depth_errors import METRICS
from deux.metrics.intervals import Estimate
from deux.metrics.tables import Cell, ResultTable, Row, error_columns

RESULTS_FILE = "results.json"
"""File of a run's results, written to its folder when it is finished."""


@dataclass(frozen=True)
class Results:
    """The results of one run. Errors are dictionaries with the keys of `deux.metrics.depth_errors.METRICS`.

    Args:
        model: name of the depth model.
        explore: name of the explorer that collected the training frames; None if the run only evaluated a model.
        seed: the run's random seed.
        frames: number of training frames, including those of all rounds; None if the run only evaluated a model.
        metrics: the trained model's errors on the test frames.
        baseline: errors of linear interpolation of the sparse points on the same frames; frames without sparse points
            are filled with the median depth of the others.
        constant: errors of the median of each frame's sparse points.
        seconds: time spent in each stage.
        trained: provenance of an evaluated model: `weights`, a hash of its file, and `settings`, the identity
            (`run.json`) of the run that trained it, or None if unknown. None for a model that the run trained.
        rounds: rounds of active collection, each with round, step, frames, area, uncertainty and mae
            (`deux.training.rounds.Round`).
        images: number of test frames; None in results of earlier versions.
        without_truth: number of test frames that are left out, since they have no ground truth in range.
        without_points: number of test frames without sparse points.
        corrected: errors of the trained model's depth corrected by the sparse points
            (`deux.geometry.depth_correction`); None in results of earlier versions.
        scenes: the errors of each floor of each test scene (`deux.metrics.model_errors.SceneErrors`): scene, frames,
            metrics and baseline; empty in results of earlier versions.
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
    images: int | None = None
    without_truth: int = 0
    without_points: int = 0
    corrected: dict[str, float] | None = None
    scenes: list[dict[str, Any]] = field(default_factory=list)

    def save(self, folder: Path) -> Path:
        """Write `results.json` to a run folder atomically; returns the file."""
        path = folder / RESULTS_FILE
        write_json(path, asdict(self))
        return path

    @classmethod
    def load(cls, folder: Path) -> "Results":
        """Read a run folder's `results.json`.

        Raises:
            DeuxError: the file is missing or not a results file.
        """
        path = folder / RESULTS_FILE
        if not path.exists():
            raise DeuxError(f"{path} does not exist: give the folder of a finished run.")
        try:
            results = read_record(path, cls)
            for errors in (results.metrics, results.baseline, results.constant):
                _check_errors(errors)
            if results.corrected is not None:
                _check_errors(results.corrected)
            for scene in results.scenes:
                _check_scene(scene)
            return results
        except (DeuxError, ValueError, TypeError, KeyError) as error:
            raise DeuxError(f"{path} is not a results file of deux ({error_text(error)}): repeat the run.") from None

    def table(self) -> ResultTable:
        """The errors as a table; the lowest of each column is bold."""
        rows = {f"{self.model}{f', {self.explore} frames' if self.explore else ''}": self.metrics}
        if self.corrected is not None:
            rows["the same, corrected by the points"] = self.corrected
        rows |= {"interpolated points": self.baseline, "median of the points": self.constant}
        training = "" if self.frames is None else f" ({counted(self.frames, 'training frame')}, seed {self.seed})"
        tested = "test frames" if self.images is None else counted(self.images, "test frame")
        return error_table(f"Errors on the {tested}{training}", rows, self._notes())

    def _notes(self) -> tuple[str, ...]:
        """Notes on test frames without ground truth or sparse points."""
        notes = []
        if number := self.without_truth:
            has, is_ = plural("has", number), plural("is", number)
            notes.append(f"{number} of the test frames {has} no ground truth in range and {is_} left out.")
        if number := self.without_points:
            notes.append(
                f"{number} of the test frames {plural('has', number)} no sparse point; interpolation and median use "
                "the median depth of the other frames there."
            )
        return tuple(notes)


def error_table(caption: str, errors: Mapping[str, Mapping[str, float]], notes: tuple[str, ...] = ()) -> ResultTable:
    """The errors of several predictions of the same frames as a table; the lowest of each column is bold.

    Args:
        caption: caption of the table, without a full stop.
        errors: errors by the prediction's label, then by the metric's name.
        notes: notes below the table, a sentence each.
    """
    rows = [Row((label,), tuple(Cell(Estimate(row[name])) for name in METRICS)) for label, row in errors.items()]
    return ResultTable(caption, ("prediction",), error_columns(), (tuple(rows),), notes=notes).ranked(second=False)


def _check_errors(errors: object) -> None:
    """Raise ValueError unless there is a number, possibly NaN, for each metric."""
    for name in METRICS:
        if not isinstance(errors, dict) or type(errors.get(name)) not in (int, float):
            raise ValueError(f"it has no number for {name}")


def _check_scene(scene: dict[str, Any]) -> None:
    """Raise ValueError, TypeError or KeyError unless a scene has the fields of `SceneErrors`."""
    if not (isinstance(scene["scene"], str) and isinstance(scene["frames"], int) and scene["frames"] > 0):
        raise ValueError("a scene has no name or no frames")
    for errors in (scene["metrics"], scene["baseline"]):
        _check_errors(errors)
