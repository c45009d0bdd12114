"""The small files of finished runs, copied to where they are kept, such as docs/results: what a report reads."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from deux.command_record import IDENTITY_FILE
from deux.errors import DeuxError
from deux.io.atomic import make_folder, write_atomically
from deux.io.json_files import checked_object, read_json
from deux.metrics.scorecard import SCORECARD_FILE
from deux.report.results import RESULTS_FILE
from deux.report.runs import OVERRIDES_FILE, find_runs, read_identity, read_overrides
from deux.report.sweeps import SWEEP_FILE, find_sweeps, sweep_file

_UNTOLD = ("seconds",)
"""What of `results.json` differs between machines and does not count in a comparison."""


def keep_runs(source: Path, folder: Path) -> tuple[int, int]:
    """Copy what a report needs of the finished runs below a folder, and of the sweeps that planned them.

    Of a run: `results.json`, `run.json`, the scorecard and the overrides; of a sweep: the grid in `multirun.yaml`. They
    lie as they lay below the source, so that a report of the copies is the report of the runs, missing ones included.
    Sweeps that were done in several sittings or on several machines are kept in one folder one after the other.

    Args:
        source: has runs and sweeps below it.
        folder: takes the copies; those of earlier calls stay.

    Returns:
        Number of runs, and number of bytes of the largest one.

    Raises:
        DeuxError: there is no finished run, a file is damaged, another run or sweep is kept under the same name, or the
            copies would lie below the source.
    """
    if folder.resolve().is_relative_to(source.resolve()):
        raise DeuxError(
            f"report.keep={folder} lies in report.runs={source}, so that the next report would take the copies for "
            "runs of their own: choose a folder elsewhere."
        )
    found = find_runs(source)
    if not found.finished:
        raise DeuxError(f"there is no run below {source} that fits into a table, so there is nothing to keep.")
    copies = {run.path: _files(run.path) for run in found.finished}
    for path, files in copies.items():
        kept = folder / path.relative_to(source)
        if (kept / RESULTS_FILE).exists() and _told(_files(kept)) != _told(files):
            raise DeuxError(
                f"{kept} is kept already and is another run than {path}: choose another folder with report.keep=..."
            )
    grids = {sweep.folder: sweep_file(sweep.folder) for sweep in find_sweeps(source)}
    for path, grid in grids.items():
        kept = folder / path.relative_to(source)
        if (kept / SWEEP_FILE).exists() and _kept_grid(kept) != grid:
            raise DeuxError(
                f"{kept} is kept already and is another sweep than {path}: choose another folder with report.keep=..."
            )
        copies.setdefault(path, {})[SWEEP_FILE] = yaml.safe_dump(grid, sort_keys=False).encode()
    for path, files in copies.items():
        # The results come last: a folder without them holds no run yet, and a killed command copies it again.
        for name, content in sorted(files.items(), key=lambda file: file[0] == RESULTS_FILE):
            target = folder / path.relative_to(source) / name
            make_folder(target.parent)
            write_atomically(target, content)
    return len(found.finished), max(sum(map(len, copies[run.path].values())) for run in found.finished)


def _kept_grid(folder: Path) -> dict[str, Any]:
    try:
        return sweep_file(folder)
    except (TypeError, KeyError, AttributeError) as error:
        raise DeuxError(f"{folder / SWEEP_FILE} is damaged, it holds no sweep: delete it.") from error


def _files(path: Path) -> dict[str, bytes]:
    """The small files of a finished run by name, JSON without line breaks."""
    files = {RESULTS_FILE: _compact(read_json(path / RESULTS_FILE))}
    if (identity := read_identity(path)) is not None:
        files[IDENTITY_FILE] = _compact(identity)
    if (path / SCORECARD_FILE).exists():
        files[SCORECARD_FILE] = _compact(read_json(path / SCORECARD_FILE))
    if (path / OVERRIDES_FILE).exists():
        # Where the outputs lay is nobody else's: the command in the report is for another machine.
        overrides = [one for one in read_overrides(path) if not one.startswith("paths.")]
        files[str(OVERRIDES_FILE)] = yaml.safe_dump(overrides).encode()
    return files


def _compact(content: Any) -> bytes:
    return (json.dumps(content) + "\n").encode()


def _told(files: Mapping[str, bytes]) -> list[Any]:
    """What must be equal for two folders to hold the same run."""
    results = checked_object(json.loads(files[RESULTS_FILE]), RESULTS_FILE)
    return [
        {name: value for name, value in results.items() if name not in _UNTOLD},
        json.loads(files[IDENTITY_FILE]) if IDENTITY_FILE in files else None,
    ]
