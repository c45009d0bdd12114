"""Archive of the small files of finished runs that a report reads, such as docs/results."""

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

_IGNORED = ("seconds",)
"""Keys of `results.json` that are ignored when comparing runs, as they depend on the machine."""


def archive_runs(source: Path, folder: Path) -> tuple[int, int]:
    """Copy the files that a report needs of the finished runs and the sweeps below a folder.

    These are, of a run, `results.json`, `run.json`, the scorecard and the overrides; of a sweep, the grid in
    `multirun.yaml`. Paths relative to the source are preserved, so that a report of the copies equals the report of the
    runs, including missing runs. Parts of a sweep that ran at different times or on different machines can be copied to
    the same folder one after the other.

    Args:
        source: folder with runs and sweeps below it.
        folder: folder of the copies; earlier copies remain.

    Returns:
        Number of runs, and size of the largest run's copy in bytes.

    Raises:
        DeuxError: there is no finished run, a file is damaged, the archive contains another run or sweep under the same
            name, or `folder` is below `source`.
    """
    if folder.resolve().is_relative_to(source.resolve()):
        raise DeuxError(
            f"report.keep={folder} is below report.runs={source}, so that the next report would count the copies as "
            "runs: choose a folder elsewhere."
        )
    finished = find_runs(source).finished
    if not finished:
        raise DeuxError(
            f"there is no finished run below {source} that a table could show: set report.runs= to a folder of runs."
        )
    copies = {run.path: _files(run.path) for run in finished}
    for path, files in copies.items():
        copy = folder / path.relative_to(source)
        if (copy / RESULTS_FILE).exists() and _compared(_files(copy)) != _compared(files):
            raise DeuxError(f"{copy} exists and is another run than {path}: choose another folder with report.keep=...")
    for sweep in find_sweeps(source):
        grid = sweep_file(sweep.folder)
        copy = folder / sweep.folder.relative_to(source)
        if (copy / SWEEP_FILE).exists() and _archived_grid(copy) != grid:
            raise DeuxError(
                f"{copy} exists and is another sweep than {sweep.folder}: choose another folder with report.keep=..."
            )
        copies.setdefault(sweep.folder, {})[SWEEP_FILE] = yaml.safe_dump(grid, sort_keys=False).encode()
    for path, files in copies.items():
        # The results come last: without them a copy does not count as a run, and a resumed command copies it again.
        for name, content in sorted(files.items(), key=lambda file: file[0] == RESULTS_FILE):
            target = folder / path.relative_to(source) / name
            make_folder(target.parent)
            write_atomically(target, content)
    return len(finished), max(sum(map(len, copies[run.path].values())) for run in finished)


def _archived_grid(folder: Path) -> dict[str, Any]:
    try:
        return sweep_file(folder)
    except (TypeError, KeyError, AttributeError) as error:
        raise DeuxError(f"{folder / SWEEP_FILE} is damaged, it contains no sweep: delete it.") from error


def _files(path: Path) -> dict[str, bytes]:
    """The content of a run's small files by name; JSON without line breaks."""
    files = {RESULTS_FILE: _compact(read_json(path / RESULTS_FILE))}
    if (identity := read_identity(path)) is not None:
        files[IDENTITY_FILE] = _compact(identity)
    if (path / SCORECARD_FILE).exists():
        files[SCORECARD_FILE] = _compact(read_json(path / SCORECARD_FILE))
    if (path / OVERRIDES_FILE).exists():
        # Paths of one machine are useless in a report's commands, which are run on others.
        overrides = [override for override in read_overrides(path) if not override.startswith("paths.")]
        files[str(OVERRIDES_FILE)] = yaml.safe_dump(overrides).encode()
    return files


def _compact(content: Any) -> bytes:
    return (json.dumps(content) + "\n").encode()


def _compared(files: Mapping[str, bytes]) -> list[Any]:
    """The values that are equal for two copies of the same run."""
    results = checked_object(json.loads(files[RESULTS_FILE]), RESULTS_FILE)
    return [
        {name: value for name, value in results.items() if name not in _IGNORED},
        json.loads(files[IDENTITY_FILE]) if IDENTITY_FILE in files else None,
    ]
