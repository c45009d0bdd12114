import os
import signal
import subprocess
import sys
import time
from functools import partial
from pathlib import Path

import pytest

from deux.errors import DeuxError
from deux.io.processes import Count, in_processes


class Note:
    """Writes a file for each item; what it is not told twice is which process it came to."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def __setstate__(self, state: dict) -> None:
        self.__dict__ = state
        (self.folder / f"arrived-{os.getpid()}").touch(exist_ok=False)

    def __call__(self, name: str, count: Count) -> None:
        (self.folder / name).write_text(str(os.getpid()))
        count(2)
        count(1)


def fail(how: str, count: Count) -> None:
    """Fail in one of several ways."""
    if how == "mistake":
        raise DeuxError("bad is not wanted.")
    if how == "bug":
        raise ValueError("odd")
    if how == "unpicklable bug":
        raise Unpicklable("odd", 1)
    if how == "killed":
        os.kill(os.getpid(), signal.SIGKILL)
    if how == "exit":
        os._exit(3)
    time.sleep(60)


class Unpicklable(Exception):
    def __init__(self, what: str, number: int) -> None:
        super().__init__(what)


def test_every_item_is_worked_on_elsewhere_and_counted_here(tmp_path):
    counted: list[int] = []
    in_processes(Note(tmp_path), ["a", "b", "c"], 2, counted.append, str)
    assert sorted(counted) == [1, 1, 1, 2, 2, 2]
    workers = {(tmp_path / name).read_text() for name in "abc"}
    assert str(os.getpid()) not in workers
    assert {f"arrived-{worker}" for worker in workers} == {path.name for path in tmp_path.glob("arrived-*")}
    assert len(workers) == 2


@pytest.mark.parametrize(
    ("how", "error", "message"),
    [
        ("mistake", DeuxError, "^bad is not wanted.$"),
        ("bug", ValueError, "^odd"),
        ("unpicklable bug", RuntimeError, "Unpicklable in another process"),
        ("killed", DeuxError, "The process that worked on 'killed' was killed by SIGKILL, as .* memory runs out"),
        ("exit", DeuxError, "The process that worked on 'exit' ended with exit code 3: run the same command again"),
    ],
)
def test_a_failure_ends_all_at_once(how, error, message):
    began = time.monotonic()
    with pytest.raises(error, match=message) as told:
        in_processes(fail, ["work for a minute", how], 2, print, repr)
    assert time.monotonic() - began < 30
    notes = "".join(getattr(told.value, "__notes__", []))
    assert ("in fail" in notes) == (error is not DeuxError)


def start_and_say(folder: str) -> None:
    """For a process of its own: work for a minute in two others, which write down who they are."""
    in_processes(partial(say_and_sleep, Path(folder)), ["a", "b"], 2, print, str)


def say_and_sleep(folder: Path, name: str, count: Count) -> None:
    (folder / name).write_text(str(os.getpid()))
    (folder / name).rename(folder / f"{name}.pid")
    time.sleep(60)


@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGKILL])
def test_no_process_outlives_the_one_that_started_it(tmp_path, how):
    code = f"import test_processes; test_processes.start_and_say({str(tmp_path)!r})"
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parent)}
    run = subprocess.Popen([sys.executable, "-c", code], env=environment, stderr=subprocess.PIPE, text=True)
    wait_until(lambda: len(list(tmp_path.glob("*.pid"))) == 2)
    workers = [int(path.read_text()) for path in tmp_path.glob("*.pid")]
    run.send_signal(how)
    assert run.communicate(timeout=20)[1].count("Traceback") == (how == signal.SIGINT)  # the workers say nothing
    wait_until(lambda: not any(Path(f"/proc/{worker}").exists() for worker in workers))


def wait_until(true) -> None:
    end = time.monotonic() + 40
    while not true():
        assert time.monotonic() < end
        time.sleep(0.05)
