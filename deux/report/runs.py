"""Reading of the runs below a folder: their results and conditions."""

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from deux.command_record import IDENTITY_FILE, RECORD_FOLDER
from deux.errors import DeuxError, error_text
from deux.io.folder_walk import walk
from deux.io.json_files import read_json
from deux.io.yaml_files import read_yaml
from deux.metrics.scorecard import SCORECARD_FILE, Scorecard
from deux.report.conditions import Conditions, FlatOptions, conditions
from deux.report.results import RESULTS_FILE, Results

_CONFIG_FILE = Path(RECORD_FOLDER, "config.yaml")
OVERRIDES_FILE = Path(RECORD_FOLDER, "overrides.yaml")
"""File of the overrides of a run's command, in its folder."""

_REFERENCE = re.compile(r"\$\{(?P<option>[\w.]+)\}")
"""An interpolation of another option, such as `${seed}`."""

_TASKS = ("experiment", "evaluate")
"""The tasks whose results belong in the tables."""


@dataclass(frozen=True)
class Run:
    """An experiment, or an evaluation of a trained model.

    Args:
        path: folder of the run.
        conditions: conditions of the run; for an evaluation, those of the training with the evaluation's test frames.
        own_testing: test frames of the training run; they differ from those of `conditions` if the model was trained on
            another dataset.
        results: results; None for an unfinished run.
        overrides: overrides of the run's command.
        scorecard: scorecard of the training frames; None for evaluations and runs of earlier versions.
    """

    path: Path
    conditions: Conditions
    own_testing: FlatOptions
    results: Results | None
    overrides: tuple[str, ...] = ()
    scorecard: Scorecard | None = None

    @property
    def errors(self) -> dict[str, float]:
        """The errors of a finished run."""
        assert self.results is not None
        return self.results.metrics


@dataclass(frozen=True)
class FoundRuns:
    """The runs below a folder.

    Args:
        finished: runs with results.
        unfinished: experiments without results: stopped, failed or still running.
        left_out: finished runs that cannot be shown in a table, with the reason.
    """

    finished: tuple[Run, ...]
    unfinished: tuple[Run, ...]
    left_out: tuple[tuple[Path, str], ...]


def find_runs(folder: Path) -> FoundRuns:
    """Read all runs at or below a folder.

    Raises:
        DeuxError: the folder does not exist, there is no finished run, or a run's file is damaged.
    """
    if not folder.is_dir():
        raise DeuxError(f"{folder} is not a folder: give one with runs or sweeps below it.")
    finished, unfinished, left_out = [], [], []
    for path in run_folders(folder):
        identity = read_identity(path)
        if identity is not None and identity.get("task") not in _TASKS:
            continue
        if (path / RESULTS_FILE).exists():
            run = _finished(path, identity)
            if isinstance(run, str):
                left_out.append((path, run))
            else:
                finished.append(run)
        elif identity and identity.get("task") == "experiment" and not identity.get("training_data"):
            overrides = read_overrides(path)
            run_conditions = conditions(identity, overrides=overrides)
            unfinished.append(Run(path, run_conditions, run_conditions.testing, None, overrides))
    if not finished and not left_out:
        count = f", {len(unfinished)} unfinished" if unfinished else ""
        raise DeuxError(f"there is no finished run below {folder}{count}: a run is finished once it has results.json.")
    return FoundRuns(tuple(finished), tuple(unfinished), tuple(left_out))


def run_folders(folder: Path) -> Iterator[Path]:
    """Folders of runs at or below a folder, sorted by name; datasets and hidden folders are skipped."""
    for path, subfolders, files in walk(folder):
        if RESULTS_FILE in files or IDENTITY_FILE in files:
            subfolders.clear()
            yield path
        elif "manifest.json" in files:
            subfolders.clear()


def _finished(path: Path, identity: dict[str, Any] | None) -> Run | str:
    """A finished run, or the reason why it cannot be shown in a table."""
    results = Results.load(path)
    if identity is None:
        options = {"model": {"name": results.model}, "explore": {"name": results.explore}, "seed": results.seed}
        identity = {"task": "experiment" if results.explore else "evaluate", **options}
    training = identity if identity["task"] == "experiment" else (results.trained or {}).get("settings")
    if not isinstance(training, Mapping) or training.get("task") not in ("experiment", "train"):
        return "the training data of its model are unknown"
    if training.get("training_data"):
        return "its model was trained on recorded frames, which no explorer collected"
    overrides = read_overrides(path)
    run_conditions = conditions(training, overrides=overrides if training is identity else ())
    tested = conditions(identity, run_conditions.seed, overrides)
    scorecard = Scorecard.load(path) if (path / SCORECARD_FILE).exists() else None
    return Run(
        path, replace(run_conditions, testing=tested.testing), run_conditions.testing, results, overrides, scorecard
    )


def read_identity(path: Path) -> dict[str, Any] | None:
    """A run's whole configuration, from `run.json` or else Hydra's `config.yaml`; None if there is neither.

    Raises:
        DeuxError: the file is damaged.
    """
    try:
        if (path / IDENTITY_FILE).exists():
            identity = read_json(path / IDENTITY_FILE)
        elif (path / _CONFIG_FILE).exists():
            identity = _resolve_options(read_yaml(path / _CONFIG_FILE))
        else:
            return None
        if not isinstance(identity, dict):
            raise TypeError("it has no options")
        conditions(identity)
        return identity
    except Exception as error:  # options may have any type, on which `conditions` fails in many ways
        problem = error_text(error)
        raise DeuxError(f"the configuration of the run {path} is damaged ({problem}): delete the folder.") from error


def _resolve_options(content: Any) -> Any:
    """Resolve interpolations of other options in a composed configuration, such as `draw: ${seed}`.

    Other interpolations are left as text, since the configuration may be untrusted: `${oc.env:NAME}` would put an
    environment variable into a report, and nested interpolations may expand without a limit.
    """

    def resolve(value: Any) -> Any:
        if isinstance(value, dict):
            return {key: resolve(item) for key, item in value.items()}
        if isinstance(value, list):
            return [resolve(item) for item in value]
        match = _REFERENCE.fullmatch(value) if isinstance(value, str) else None
        target = content
        for name in match["option"].split(".") if match else ():
            target = target.get(name, {}) if isinstance(target, dict) else {}
        return target if match and not (isinstance(target, dict | list) or "${" in str(target)) else value

    return resolve(content)


def read_overrides(path: Path) -> tuple[str, ...]:
    """The overrides of a run's command; empty if unknown."""
    try:
        overrides = read_yaml(path / OVERRIDES_FILE)
    except DeuxError:
        return ()
    return tuple(map(str, overrides)) if isinstance(overrides, list) else ()
