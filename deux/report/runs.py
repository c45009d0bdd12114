"""The runs below a folder: their results, and what made them."""

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
"""The overrides of a run's command, in its folder."""

_REFERENCE = re.compile(r"\$\{(?P<option>[\w.]+)\}")
"""A whole value that is that of another option, as `${seed}`."""

_TASKS = ("experiment", "evaluate")
"""The tasks whose results belong in the tables."""


@dataclass(frozen=True)
class Run:
    """One run of an experiment or of the evaluation of a trained model.

    Args:
        path: its folder.
        conditions: what made it; of an evaluation, what made its model and the frames that it was tested on.
        own_testing: what makes the test frames of the training run itself; others than those of `conditions` where the
            model was trained on another dataset.
        results: its errors; None if it was begun and is not finished.
        overrides: its command's.
        scorecard: of its training frames; None where it has none, as runs of earlier versions and evaluations.
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
        begun: experiments without results: stopped, failed or still running.
        left_out: finished runs that fit into no table, with the reason.
    """

    finished: tuple[Run, ...]
    begun: tuple[Run, ...]
    left_out: tuple[tuple[Path, str], ...]


def find_runs(folder: Path) -> FoundRuns:
    """Read all runs below a folder, or the folder's own.

    Raises:
        DeuxError: there is no such folder, no finished run, or a run's file is damaged.
    """
    if not folder.is_dir():
        raise DeuxError(f"{folder} is no folder: name one that has runs or sweeps below it.")
    finished, begun, left_out = [], [], []
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
            made_of = conditions(identity, overrides=overrides)
            begun.append(Run(path, made_of, made_of.testing, None, overrides))
    if not finished and not left_out:
        unfinished = f", {len(begun)} begun and not finished" if begun else ""
        raise DeuxError(
            f"there is no finished run below {folder}{unfinished}: a run is finished once it has results.json."
        )
    return FoundRuns(tuple(finished), tuple(begun), tuple(left_out))


def run_folders(folder: Path) -> Iterator[Path]:
    """Folders of runs at or below a folder, by name; datasets and hidden folders are not looked into."""
    for found, below, files in walk(folder):
        if RESULTS_FILE in files or IDENTITY_FILE in files:
            below.clear()
            yield found
        elif "manifest.json" in files:
            below.clear()


def _finished(path: Path, identity: dict[str, Any] | None) -> Run | str:
    """A run with results, or why it fits into no table."""
    results = Results.load(path)
    if identity is None:
        named = {"model": {"name": results.model}, "explore": {"name": results.explore}, "seed": results.seed}
        identity = {"task": "experiment" if results.explore else "evaluate", **named}
    trained_by = identity if identity["task"] == "experiment" else (results.trained or {}).get("settings")
    if not isinstance(trained_by, Mapping) or trained_by.get("task") not in ("experiment", "train"):
        return "it is not known on what its model was trained"
    if trained_by.get("training_data"):
        return "its model was trained on a given dataset, which no explorer collected for it"
    overrides = read_overrides(path)
    made_of = conditions(trained_by, overrides=overrides if trained_by is identity else ())
    tested = conditions(identity, made_of.seed, overrides)
    made_of, own_testing = replace(made_of, testing=tested.testing), made_of.testing
    scorecard = Scorecard.load(path) if (path / SCORECARD_FILE).exists() else None
    return Run(path, made_of, own_testing, results, overrides, scorecard)


def read_identity(path: Path) -> dict[str, Any] | None:
    """A run's whole configuration, from `run.json` or else from what Hydra composed; None if neither is there.

    Raises:
        DeuxError: the file is damaged.
    """
    try:
        if (path / IDENTITY_FILE).exists():
            found = read_json(path / IDENTITY_FILE)
        elif (path / _CONFIG_FILE).exists():
            found = _with_own_references(read_yaml(path / _CONFIG_FILE))
        else:
            return None
        if not isinstance(found, dict):
            raise TypeError("it holds no options")
        conditions(found)
        return found
    except Exception as error:  # options of any type, which `conditions` takes apart
        problem = error_text(error)
        raise DeuxError(f"the configuration of the run {path} is damaged ({problem}): delete the folder.") from error


def _with_own_references(content: Any) -> Any:
    """A composed configuration with the values of options that are those of other options, as `draw: ${seed}`.

    Any other reference stays the text that it is. Somebody else's configuration is data: `${oc.env:NAME}` would put a
    variable of this machine into a report, and references to texts of references grow without an end.
    """

    def followed(value: Any) -> Any:
        if isinstance(value, dict):
            return {key: followed(item) for key, item in value.items()}
        if isinstance(value, list):
            return [followed(item) for item in value]
        found = _REFERENCE.fullmatch(value) if isinstance(value, str) else None
        target = content
        for name in found["option"].split(".") if found else ():
            target = target.get(name, {}) if isinstance(target, dict) else {}
        return target if found and not (isinstance(target, dict | list) or "${" in str(target)) else value

    return followed(content)


def read_overrides(path: Path) -> tuple[str, ...]:
    """The overrides of the run's command; none where they are not known."""
    try:
        overrides = read_yaml(path / OVERRIDES_FILE)
    except DeuxError:
        return ()
    return tuple(map(str, overrides)) if isinstance(overrides, list) else ()
