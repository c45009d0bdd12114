"""A run's folder: which run it belongs to, how long its stages took, and whether it is finished."""

import hashlib
import json
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from deux.deployment.model_files import MODEL_FILE
from deux.errors import DeuxError
from deux.io.atomic import make_folder, write_json
from deux.policies.policy_files import POLICY_FILE
from deux.policies.training_state import CHECKPOINT_FILE
from deux.report.results import IDENTITY_FILE, RESULTS_FILE
from deux.training.ranks import leads

_SECONDS_FILE = "seconds.json"

EPISODES = "episodes"
"""The folder of the episodes that a comparison has finished."""

ROUNDS = "rounds"
"""The folder of what a training with active collection has explored, and of the weights that explored."""

_WORK = ("checkpoints", CHECKPOINT_FILE, EPISODES, ROUNDS, MODEL_FILE, POLICY_FILE, RESULTS_FILE)
"""What a run leaves in its folder that another run must not go on from."""


class RunFolder:
    """Where one run keeps what it leaves behind; the same command again finds it and goes on.

    Where several processes train together, the leading one alone writes here.

    Args:
        path: the folder; made if it is absent.
        settings: all that makes the run what it is, JSON-able. A folder with the work of other settings is refused.

    Raises:
        DeuxError: the folder holds the checkpoints, model or results of other settings.
    """

    def __init__(self, path: Path, settings: Mapping[str, Any]) -> None:
        self.path = path
        if not leads():
            return
        make_folder(path)
        identity = path / IDENTITY_FILE
        mine = json.loads(json.dumps(settings))
        if identity.exists() and any((path / work).exists() for work in _WORK):
            theirs = json.loads(identity.read_text())
            if theirs != mine:
                different = ", ".join(sorted(_differences(theirs, mine))[:4])
                raise DeuxError(
                    f"{path} holds a run with other settings ({different}); "
                    "choose another folder with hydra.run.dir=... or delete this one."
                )
        else:
            write_json(identity, mine)

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
        return json.loads(path.read_text()) if path.exists() else {}

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


def short_hash(content: Any) -> str:
    """Eight hexadecimal digits that name a JSON-able value."""
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()[:8]


def _differences(theirs: Any, mine: Any, where: str = "") -> Iterator[str]:
    if isinstance(theirs, dict) and isinstance(mine, dict):
        for key in theirs.keys() | mine.keys():
            yield from _differences(theirs.get(key), mine.get(key), f"{where}.{key}" if where else key)
    elif theirs != mine:
        yield f"{where}: {theirs} there, {mine} here"
