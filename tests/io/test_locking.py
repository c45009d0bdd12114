"""Locks, against real processes that are killed, suspended or on another machine."""

import json
import logging
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, replace
from pathlib import Path

import pytest

from deux.errors import DeuxError
from deux.io import locking
from deux.io.locking import Holder, clear_abandoned, locked, locked_at_once

START = "import sys, time; from pathlib import Path; from deux.io.locking import locked; path = Path(sys.argv[1])\n"

HOLD = """
with locked(path, "holds", lease=float(sys.argv[2])):
    print("held", flush=True)
    for _ in range(600):  # a signal that arrives just before a sleep does not end that sleep
        time.sleep(0.1)
"""

COUNT = """
counter = path.with_name("counter")
for _ in range(50):
    with locked(path, "counts"):
        counter.write_text(str(int(counter.read_text()) + 1))
"""

Start = Callable[..., subprocess.Popen[str]]


@pytest.fixture
def start() -> Iterator[Start]:
    """Start a process that runs this text: start(HOLD, path, lease); it is killed at the end."""
    started = []

    def popen(text: str, *arguments: object) -> subprocess.Popen[str]:
        command = [sys.executable, "-c", START + text, *map(str, arguments)]
        started.append(subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True))
        return started[-1]

    yield popen
    for process in started:
        process.kill()
        process.communicate()


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / ".lock.json"


@pytest.fixture
def holding(start: Start, path: Path) -> Callable[[float], subprocess.Popen[str]]:
    """Start a process that holds the lock with this lease."""

    def hold(lease: float = 60) -> subprocess.Popen[str]:
        process = start(HOLD, path, lease)
        assert process.stdout is not None
        assert process.stdout.readline() == "held\n"
        return process

    return hold


def seconds_to_lock(path: Path) -> float:
    started = time.monotonic()
    with locked(path, "waits"):
        return time.monotonic() - started


def foreign_lock(path: Path, lease: float) -> Holder:
    """Leave the lock of a process of another machine, whose process id is in use here too."""
    holder = Holder("elsewhere", "another boot", os.getppid(), 1, "collects flats", lease, "token")
    path.write_text(json.dumps(asdict(holder)))
    return holder


def test_processes_take_turns(start, path):
    path.with_name("counter").write_text("0")
    for process in [start(COUNT, path) for _ in range(4)]:
        assert process.wait(60) == 0
    assert path.with_name("counter").read_text() == "200"
    assert os.listdir(path.parent) == ["counter"]


def test_taking_and_releasing_costs_less_than_five_milliseconds(path):
    def seconds() -> float:
        started = time.perf_counter()
        with locked(path, "measures"):
            pass
        return time.perf_counter() - started

    assert sorted(seconds() for _ in range(21))[10] < 0.005


def test_the_file_names_its_holder_and_is_gone_afterwards(path):
    with locked(path, "collects flats") as lock:
        named = json.loads(path.read_text())
        lock.confirm()
    assert (named["pid"], named["work"]) == (os.getpid(), "collects flats")
    assert str(lock.holder) == f"{os.uname().nodename}:{os.getpid()}, which collects flats"
    assert not os.listdir(path.parent)


def test_locks_of_different_files_nest(tmp_path):
    with locked(tmp_path / "a", "works"), locked(tmp_path / "b", "works"):
        again = locked_at_once(tmp_path / "a", "works", "taken")
        with pytest.raises(DeuxError, match=r"^taken$"), again:
            pass
    assert not os.listdir(tmp_path)


def test_a_killed_holder_is_followed_at_once(holding, path):
    process = holding()
    process.kill()
    os.waitid(
        os.P_PID, process.pid, os.WEXITED | os.WNOWAIT
    )  # it ended, and its parent has not asked for its exit code
    assert seconds_to_lock(path) < 20  # of the lease of a minute
    process = holding()
    process.kill()
    process.wait()
    with locked_at_once(path, "works", "taken"):
        pass


def test_a_process_id_that_is_in_use_again_is_not_the_holder(path):
    with locked(path, "works") as lock:
        dead = replace(lock.holder, started=1, token="of a process with this id, before")
    path.write_text(json.dumps(asdict(dead)))
    assert seconds_to_lock(path) < 20  # of the lease of a minute


def test_a_live_holder_is_waited_for_and_named_once(holding, path, monkeypatch, caplog):
    monkeypatch.setattr(locking, "_NOTICE_AFTER", 0.1)
    process = holding()
    with caplog.at_level(logging.WARNING), pytest.raises(KeyboardInterrupt):  # noqa: PT012
        signal.setitimer(signal.ITIMER_REAL, 1.0)
        previous = signal.signal(signal.SIGALRM, signal.default_int_handler)
        try:
            seconds_to_lock(path)
        finally:
            signal.setitimer(signal.ITIMER_REAL, 0)
            signal.signal(signal.SIGALRM, previous)
    waiting = f"waiting for {os.uname().nodename}:{process.pid}, which holds ({path})"
    assert [record.getMessage() for record in caplog.records] == [waiting]
    with pytest.raises(DeuxError, match=r"^taken$"), locked_at_once(path, "works", "taken"):
        pass


def test_the_lock_of_a_machine_that_is_gone_is_taken_after_the_lease(path):
    foreign_lock(path, lease=0.5)
    assert seconds_to_lock(path) > 0.5
    foreign_lock(path, lease=0.5)
    with locked_at_once(path, "works", "taken"):
        assert json.loads(path.read_text())["pid"] == os.getpid()


def test_the_clocks_of_the_machines_need_not_agree(path):
    for hours in (-5, 5):
        foreign_lock(path, lease=0.5)
        os.utime(path, (time.time() + 3600 * hours,) * 2)
        assert seconds_to_lock(path) > 0.5


def test_the_lock_of_another_machine_that_refreshes_it_is_left(holding, path, monkeypatch):
    process = holding(2.0)
    monkeypatch.setattr(locking, "_machine", lambda: "this one")  # so that the holder's is another
    with pytest.raises(DeuxError, match=r"^taken$"), locked_at_once(path, "works", "taken"):
        pass
    process.kill()  # which this machine cannot know of
    assert seconds_to_lock(path) > 1.0


@pytest.mark.parametrize("content", ["", "{", "[]", '{"pid": 1}'])
def test_a_file_that_names_nobody_is_removed_after_the_lease(path, content, monkeypatch):
    monkeypatch.setattr(locking, "LEASE", 0.3)
    path.write_text(content)
    assert seconds_to_lock(path) > 0.3


def test_a_suspended_holder_loses_the_lock_and_gets_an_error(holding, path):
    process = holding(0.6)
    process.send_signal(signal.SIGSTOP)
    started = time.monotonic()
    with locked(path, "follows", lease=0.6) as lock:
        assert time.monotonic() - started > 0.5
        process.send_signal(signal.SIGCONT)
        assert process.wait(30) == 1  # interrupted in its minute of work
        lock.confirm()
        assert path.exists()
    assert process.stderr is not None
    told = process.stderr.read().splitlines()[-1]
    assert told.startswith(
        f"deux.errors.DeuxError: The lock {path} was lost, {os.uname().nodename}:{os.getpid()}, which"
    )
    assert told.endswith("follows holds it now: this process was suspended for 1 s or longer, or the file was deleted; "
                         "start the same command again to resume.")  # fmt: skip


def test_a_lost_lock_is_not_released_for_its_next_holder(path):
    with pytest.raises(DeuxError, match=r"elsewhere:\d+, which collects flats holds it now"):  # noqa: SIM117, PT012
        with locked(path, "works") as lock:
            foreign_lock(path, lease=60)
            lock.confirm()
    assert json.loads(path.read_text())["host"] == "elsewhere"


def test_a_deleted_lock_is_lost(path):
    with pytest.raises(DeuxError, match="was lost, its file was deleted"), locked(path, "works") as lock:  # noqa: PT012
        path.unlink()
        lock.confirm()


def test_a_later_holders_file_is_put_back(path):
    """Two waiters saw the same dead holder; the slower one moves the file of the faster one, and notices."""
    dead, alive = replace(foreign_lock(path, 60), token="dead"), foreign_lock(path, 60)
    assert not locking._remove(path, dead)
    real, looks = locking._read, iter([(dead, 0)])
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(locking, "_read", lambda file: next(looks, None) or real(file))
        assert not locking._remove(path, dead)
    assert os.listdir(path.parent) == [path.name]
    assert Holder(**json.loads(path.read_text())) == alive


def test_the_file_of_a_killed_holder_can_be_cleared_and_that_of_a_live_one_not(holding, path):
    clear_abandoned(path)
    holder = holding(60.0)
    clear_abandoned(path)
    assert path.exists()
    holder.kill()
    holder.wait()
    clear_abandoned(path)
    assert not path.exists()


def test_what_a_kill_left_of_a_removal_goes_with_the_next_lock_of_the_folder(holding, path, tmp_path):
    """Killed between the two steps of a removal. The file of a live holder stays, as it may be put back."""
    killed = holding(60.0)
    dead, live = tmp_path / ".other.lock.json.0123abcd", tmp_path / ".lock.json.4567abcd"
    os.rename(path, dead)
    killed.kill()
    killed.wait()
    holding(60.0)
    os.rename(path, live)
    with locked(path, "is next"):
        assert not dead.exists()
    assert live.exists()


def test_a_folder_that_cannot_be_written_is_named(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(DeuxError, match=f"Folder {tmp_path}/file/folder cannot be created: Not a directory"):
        seconds_to_lock(tmp_path / "file" / "folder" / "lock")
