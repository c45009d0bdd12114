"""`results.json`: the errors of a finished run."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from deux.errors import DeuxError, counted, plural
from deux.io.atomic import write_json
from deux.io.json_files import read_record
from deux.metrics.depth_errors import METRICS
from deux.metrics.intervals import Estimate
from deux.metrics.tables import Cell, ResultTable, Row, error_columns

RESULTS_FILE = "results.json"
"""A run's results, in its folder once it is finished."""


@dataclass(frozen=True)
class Results:
    """The errors of one run on the test frames, each a dictionary with the keys of `deux.metrics.depth_errors.METRICS`.

    Args:
        model: name of the depth model.
        explore: name of the explorer that collected the training frames; None if the model was given.
        seed: the run's random seed.
        frames: number of training frames, those of all rounds included; None if the model was given.
        metrics: the trained model's errors.
        baseline: the same for linear interpolation of the sparse points, on the same frames; in a frame without any,
            for the median depth of the others.
        constant: the same for the median of each frame's sparse points.
        seconds: time spent in each stage.
        trained: of a given model, where it comes from: `weights`, a digest of its file, and `settings`, the identity
            (`run.json`) of the run that trained it, None if it is not known; None for a model of the run's own.
        rounds: of active collection, each with round, step, frames, area, uncertainty and mae
            (`deux.training.rounds.Round`); none without it.
        images: number of test frames; None in results of earlier versions.
        without_truth: number of test frames that count in no mean, since they have no ground truth in range.
        without_points: number of test frames that have no sparse point.
        scenes: the errors of each floor of each test scene, as of `deux.metrics.model_errors.SceneErrors`: scene,
            frames, metrics and baseline; none in results of earlier versions.
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
    scenes: list[dict[str, Any]] = field(default_factory=list)

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
        if not path.exists():
            raise DeuxError(f"{path} does not exist: {folder} holds no finished run.")
        try:
            results = read_record(path, cls)
            for errors in (results.metrics, results.baseline, results.constant):
                _check_errors(errors)
            for scene in results.scenes:
                _check_scene(scene)
            return results
        except (DeuxError, ValueError, TypeError, KeyError) as error:
            raise DeuxError(f"{path} is no results file of deux ({error}); run it again.") from None

    def table(self) -> ResultTable:
        """The errors as a table, the lowest of each column in bold."""
        rows = {
            f"{self.model}{f', {self.explore} frames' if self.explore else ''}": self.metrics,
            "interpolated points": self.baseline,
            "median of the points": self.constant,
        }
        training = "" if self.frames is None else f" ({counted(self.frames, 'training frame')}, seed {self.seed})"
        tested = "test frames" if self.images is None else counted(self.images, "test frame")
        return error_table(f"Errors on the {tested}{training}", rows, self._notes())

    def _notes(self) -> tuple[str, ...]:
        """What the numbers leave out or stand for, if anything."""
        found = []
        if number := self.without_truth:
            lack, count = plural("has", number), plural("does", number)
            found.append(f"{number} of the test frames {lack} no ground truth in range and {count} not count.")
        if self.without_points:
            found.append(
                f"{self.without_points} of the test frames {plural('has', self.without_points)} no sparse point; "
                "interpolation and median take the median depth of the other frames there."
            )
        return tuple(found)


def error_table(caption: str, errors: Mapping[str, Mapping[str, float]], notes: tuple[str, ...] = ()) -> ResultTable:
    """The errors of several predictions of the same frames as a table, the lowest of each column in bold.

    Args:
        caption: what the table shows, without a full stop.
        errors: by the prediction's label, then by the metric's name.
        notes: what a reader has to know, a sentence each.
    """
    rows = [Row((label,), tuple(Cell(Estimate(row[name])) for name in METRICS)) for label, row in errors.items()]
    return ResultTable(caption, ("prediction",), error_columns(), (tuple(rows),), notes=notes).ranked(second=False)


def _check_errors(errors: object) -> None:
    """Raise ValueError unless there is a number for each metric; NaN is one."""
    for name in METRICS:
        if not isinstance(errors, dict) or type(errors.get(name)) not in (int, float):
            raise ValueError(f"it has no number for {name}")


def _check_scene(scene: dict[str, Any]) -> None:
    """Raise ValueError or TypeError unless it is what `SceneErrors` has."""
    if not (isinstance(scene["scene"], str) and isinstance(scene["frames"], int) and scene["frames"] > 0):
        raise ValueError("a scene has no name or no frames")
    for errors in (scene["metrics"], scene["baseline"]):
        _check_errors(errors)
