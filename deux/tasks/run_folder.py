"""A run's folder: which run it belongs to, who works in it, and how long its stages took."""

import hashlib
import json
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from hydra.core.hydra_config import HydraConfig
from omegaconf import OmegaConf

from deux.command_record import IDENTITY_FILE, RECORD_FOLDER
from deux.configuration import compose, job_overrides, run_folder
from deux.deployment.model_files import MODEL_FILE
from deux.errors import DeuxError
from deux.io.atomic import make_folder, write_atomically, write_json
from deux.io.json_files import read_json, read_record
from deux.io.locking import locked_at_once
from deux.policies.policy_files import POLICY_FILE
from deux.policies.training_state import CHECKPOINT_FILE
from deux.report.results import RESULTS_FILE
from deux.training.ranks import leads

_SECONDS_FILE = "seconds.json"
_LOCK_FILE = ".lock.json"
_WEIGHTS = "weights of options"  # in `IDENTITY_FILE`, where no section is called so
_FILES = "files of options"  # likewise

EPISODES = "episodes"
"""The folder of the episodes that a comparison has finished."""

ROUNDS = "rounds"
"""The folder of what a training with active collection has explored, and of the weights that explored."""

JOURNAL = "frames.jsonl"
"""The file that tells which of many frames are predicted."""

_WORK = ("checkpoints", CHECKPOINT_FILE, EPISODES, ROUNDS, MODEL_FILE, POLICY_FILE, RESULTS_FILE, JOURNAL)
"""What a run leaves in its folder that another run must not go on from."""


class RunFolder:
    """Where one run keeps what it leaves behind; the same command again finds it and goes on.

    Where several processes train together, the leading one alone writes here. Open it by `open_run_folder`, which
    keeps other commands out.

    Args:
        path: the folder.
    """

    def __init__(self, path: Path) -> None:
        self.path = path

    @property
    def figures(self) -> Path:
        """Folder of the figures."""
        return self.path / "figures"

    @property
    def logs(self) -> Path:
        """Folder of the CSV and TensorBoard logs."""
        return self.path / "logs"

    @property
    def seconds(self) -> dict[str, float]:
        """Seconds spent in each stage so far, over all starts of this run."""
        path = self.path / _SECONDS_FILE
        return read_record(path, dict[str, float]) if path.exists() else {}

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Count the time spent inside, also when it ends by an error."""
        started = time.perf_counter()
        try:
            yield
        except BaseException:
            with suppress(DeuxError):  # a full disk must not hide what ended the stage
                self._count(name, time.perf_counter() - started)
            raise
        self._count(name, time.perf_counter() - started)

    def _count(self, name: str, seconds: float) -> None:
        if not leads():
            return
        earlier = self.seconds
        write_json(self.path / _SECONDS_FILE, earlier | {name: round(earlier.get(name, 0.0) + seconds, 2)})


@contextmanager
def open_run_folder(
    path: Path,
    identity: Mapping[str, Any],
    weights: Mapping[str, str] | None = None,
    files: Mapping[str, str] | None = None,
) -> Iterator[RunFolder]:
    """Work in a run's folder, which is made if it is absent, and keep other commands out meanwhile.

    Args:
        path: the folder.
        identity: all that makes the run what it is, JSON-able.
        weights: what identifies the weights that options name (`deux.tasks.named_weights`), by option. A folder does
            not refuse those that it has no record of, as earlier versions kept none.
        files: what identifies the recorded frames that options name (`deux.tasks.recorded_frames.given_files`),
            likewise.

    Raises:
        DeuxError: another command works there, or the folder holds the work of other settings, weights or frames.
    """
    if not leads():
        yield RunFolder(path)
        return
    make_folder(path)
    taken = (
        f"another command is at work in {path}: wait until it has ended, or choose another one with hydra.run.dir=..."
    )
    with locked_at_once(path / _LOCK_FILE, f"works in {path.name}", taken):
        _claim(path, json.loads(json.dumps(identity)), {_WEIGHTS: dict(weights or {}), _FILES: dict(files or {})})
        yield RunFolder(path)


def changed(known: Mapping[str, str], now: Mapping[str, str]) -> list[str]:
    """The options whose weights or files are others than those recorded; none of which there is no record."""
    return sorted(option for option, identity in now.items() if known.get(option, identity) != identity)


def short_hash(content: Any) -> str:
    """Eight hexadecimal digits that name a JSON-able value."""
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()[:8]


def _claim(path: Path, mine: Any, named: dict[str, dict[str, str]]) -> None:
    """Write down to which run the folder belongs, unless it holds the work of another one.

    Args:
        path: the folder.
        mine: the settings.
        named: what identifies the weights and files that options name, by `_WEIGHTS` and `_FILES`.
    """
    record = path / IDENTITY_FILE
    if not (record.exists() and any((path / work).exists() for work in _WORK)):
        if record.exists() and HydraConfig.initialized() and path == run_folder():
            _record_command(path)  # Hydra has not, as this might have been another command's folder
        write_json(record, _with_named(mine, named))
        return
    theirs = read_json(record)
    known = {key: theirs.pop(key, {}) if isinstance(theirs, dict) else {} for key in named}
    if different := sorted(_differences(theirs, mine)):
        raise DeuxError(
            f"{path} holds a run with other settings ({', '.join(different[:4])}); "
            "choose another folder with hydra.run.dir=... or delete this one."
        )
    for key, what, those in ((_WEIGHTS, "weights", "those"), (_FILES, "recorded frames", "the files")):
        if options := changed(known[key], named[key]):
            raise DeuxError(
                f"{path} holds a run with other {what}: {those} of {', '.join(options)} have changed since it was "
                "begun; choose another folder with hydra.run.dir=... or delete this one."
            )
    if any(named[key].keys() - known[key].keys() for key in named):
        write_json(record, _with_named(mine, {key: known[key] | named[key] for key in named}))


def _record_command(path: Path) -> None:
    """Write what this command was into the folder, as Hydra does."""
    overrides = job_overrides()
    make_folder(path / RECORD_FOLDER)
    for name, content in (("config.yaml", compose(overrides)), ("overrides.yaml", OmegaConf.create(overrides))):
        write_atomically(path / RECORD_FOLDER / name, OmegaConf.to_yaml(content).encode())


def _with_named(identity: Any, named: Mapping[str, dict[str, str]]) -> Any:
    """What `IDENTITY_FILE` holds."""
    return identity | {key: content for key, content in named.items() if content}


def _differences(theirs: Any, mine: Any, where: str = "") -> Iterator[str]:
    """What differs; an option that is null is as one that an earlier version did not have."""
    if isinstance(theirs, dict) and isinstance(mine, dict):
        for key in theirs.keys() | mine.keys():
            yield from _differences(theirs.get(key), mine.get(key), f"{where}.{key}" if where else key)
    elif theirs != mine:
        yield f"{where}: {theirs} there, {mine} here"
