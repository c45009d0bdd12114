"""The folder of a run: identity of the run, locking, and duration of its stages."""

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
from deux.configuration import compose, in_sweep, job_overrides, run_folder
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
_WEIGHTS = "weights of options"  # key in `IDENTITY_FILE`; no section has this name
_FILES = "files of options"  # likewise

EPISODES = "episodes"
"""Folder of the finished episodes of a comparison."""

ROUNDS = "rounds"
"""Folder of the datasets and weights of the rounds of active collection."""

JOURNAL = "frames.jsonl"
"""Journal of the frames that are predicted (`deux.tasks.prediction_folder`)."""

_RESUMABLE = ("checkpoints", CHECKPOINT_FILE, EPISODES, ROUNDS, MODEL_FILE, POLICY_FILE, RESULTS_FILE, JOURNAL)
"""Files and folders from which a run resumes, and from which a different run must not."""


class RunFolder:
    """The output folder of a run, from which the same command resumes. Open it with `open_run_folder`, which locks it.

    Of several processes that train together, only rank 0 writes to it.

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
        """Seconds spent in each stage so far, over all attempts of this run."""
        path = self.path / _SECONDS_FILE
        return read_record(path, dict[str, float]) if path.exists() else {}

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Context manager that adds the time spent in it to the stage `name`, also in case of an error."""
        started = time.perf_counter()
        try:
            yield
        except BaseException:
            with suppress(DeuxError):  # a full disk must not hide the original error
                self._add_seconds(name, time.perf_counter() - started)
            raise
        self._add_seconds(name, time.perf_counter() - started)

    def _add_seconds(self, name: str, seconds: float) -> None:
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
    """Open a run folder, which is created if it does not exist, and lock it against other commands.

    Args:
        path: the folder.
        identity: identity of the run; JSON-serialisable.
        weights: hashes of the weights that options refer to (`deux.tasks.named_weights`), by option. Options that the
            folder has no hash of are accepted, since earlier versions stored none.
        files: digests of the recorded frames that options refer to (`deux.tasks.recorded_frames.data_digest`),
            likewise.

    Raises:
        DeuxError: another command uses the folder, or it contains a run with other settings, weights or frames.
    """
    if not leads():
        yield RunFolder(path)
        return
    make_folder(path)
    locked_message = f"another command is using {path}: wait until it has ended, or {_choose_another()}"
    with locked_at_once(path / _LOCK_FILE, f"works in {path.name}", locked_message):
        _claim(path, json.loads(json.dumps(identity)), {_WEIGHTS: dict(weights or {}), _FILES: dict(files or {})})
        yield RunFolder(path)


def changed_options(recorded: Mapping[str, str], current: Mapping[str, str]) -> list[str]:
    """The options whose weights or files have changed since they were recorded; unrecorded ones are accepted."""
    return sorted(option for option, identity in current.items() if recorded.get(option, identity) != identity)


def short_hash(content: Any) -> str:
    """Hash of a JSON-serialisable value, for names: 8 hexadecimal digits."""
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()[:8]


def _claim(path: Path, settings: Any, hashes: dict[str, dict[str, str]]) -> None:
    """Record the identity of a run in its folder, unless the folder contains a different run.

    Args:
        path: the folder.
        settings: the run's settings.
        hashes: hashes of weights and files by option, under `_WEIGHTS` and `_FILES`.
    """
    record = path / IDENTITY_FILE
    if not (record.exists() and any((path / name).exists() for name in _RESUMABLE)):
        if record.exists() and HydraConfig.initialized() and path == run_folder():
            _record_command(path)  # Hydra has not done so, since the folder might have been another command's
        write_json(record, _identity_record(settings, hashes))
        return
    recorded = read_json(record)
    recorded_hashes = {key: recorded.pop(key, {}) if isinstance(recorded, dict) else {} for key in hashes}
    if different := sorted(_differences(recorded, settings)):
        raise DeuxError(
            f"{path} contains a run with other settings ({', '.join(different[:4])}): {_choose_another()} or "
            "delete this one."
        )
    for key, what in ((_WEIGHTS, "weights"), (_FILES, "recorded frames")):
        if options := changed_options(recorded_hashes[key], hashes[key]):
            raise DeuxError(
                f"{path} contains a run with other {what}, the files of {', '.join(options)} have changed since it "
                f"started: {_choose_another()} or delete this one."
            )
    if any(hashes[key].keys() - recorded_hashes[key].keys() for key in hashes):
        write_json(record, _identity_record(settings, {key: recorded_hashes[key] | hashes[key] for key in hashes}))


def _choose_another() -> str:
    """The remedy for a run folder that cannot be used; sweeps ignore `hydra.run.dir`."""
    return f"choose another folder with {'hydra.sweep.dir' if in_sweep() else 'hydra.run.dir'}=..."


def _record_command(path: Path) -> None:
    """Write the command's configuration and overrides to the folder, as Hydra does."""
    overrides = job_overrides()
    make_folder(path / RECORD_FOLDER)
    for name, content in (("config.yaml", compose(overrides)), ("overrides.yaml", OmegaConf.create(overrides))):
        write_atomically(path / RECORD_FOLDER / name, OmegaConf.to_yaml(content).encode())


def _identity_record(settings: Any, hashes: Mapping[str, dict[str, str]]) -> Any:
    """The content of `IDENTITY_FILE`."""
    return settings | {key: content for key, content in hashes.items() if content}


def _differences(recorded: Any, current: Any, where: str = "") -> Iterator[str]:
    """The options that differ; null equals absent, since earlier versions did not have all options."""
    if isinstance(recorded, dict) and isinstance(current, dict):
        for key in recorded.keys() | current.keys():
            yield from _differences(recorded.get(key), current.get(key), f"{where}.{key}" if where else key)
    elif recorded != current:
        yield f"{where}: {recorded} there, {current} here"
