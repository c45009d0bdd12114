import os
from functools import partial
from pathlib import Path

import pytest

from deux.errors import DeuxError
from deux.io.processes import in_processes


def write_own_process(name: str, folder: Path) -> None:
    if name == "bad":
        raise DeuxError("bad is not wanted.")
    (folder / name).write_text(str(os.getpid()))


def test_items_are_worked_on_elsewhere_and_reported_here(tmp_path):
    done: list[str] = []
    in_processes(partial(write_own_process, folder=tmp_path), ["a", "b", "c"], 2, done.append)
    assert sorted(done) == ["a", "b", "c"]
    workers = {(tmp_path / name).read_text() for name in done}
    assert str(os.getpid()) not in workers
    assert 1 <= len(workers) <= 2


def test_an_error_ends_the_work(tmp_path):
    with pytest.raises(DeuxError, match="bad is not wanted"):
        in_processes(partial(write_own_process, folder=tmp_path), ["bad"], 1, lambda name: None)
