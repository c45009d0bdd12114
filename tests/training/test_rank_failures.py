"""Two processes of which one fails, dies or hangs: both end, and both say why."""

import importlib.util
import os
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from pathlib import Path
from socket import socket

import pytest
import torch

from deux.errors import DeuxError
from deux.training import rank_failures, rank_watch
from deux.training.rank_failures import EndTogether, share_failure
from deux.training.rank_watch import RankWatch

PROGRAM = Path(__file__).with_name("watched_rank.py")
_spec = importlib.util.spec_from_file_location("watched_rank", PROGRAM)
assert _spec is not None
assert _spec.loader is not None
watched_rank = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(watched_rank)
TOLD = "deux: process 1 of the 2 that train together: a frame is broken."
NO_LEADER = "deux: the leading one of the processes that train together has ended."


def free_port() -> int:
    with closing(socket()) as found:
        found.bind(("127.0.0.1", 0))
        return found.getsockname()[1]


def start(rank: int, port: int, way: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, str(PROGRAM), str(rank), str(port), way],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        env=os.environ | {"OMP_NUM_THREADS": "1", "TORCH_CPP_LOG_LEVEL": "ERROR"},
    )


def ended(*started: subprocess.Popen[str]) -> list[tuple[int, str]]:
    """Exit code and last line of stderr of each process."""
    try:
        outputs = [process.communicate(timeout=250)[1] for process in started]
    finally:
        for process in started:
            process.kill()
    return [
        (process.returncode, next(iter(reversed(output.splitlines())), ""))
        for process, output in zip(started, outputs, strict=True)
    ]


def test_a_process_that_waits_ends_with_the_sentence_of_the_one_that_failed():
    port = free_port()
    leader = start(0, port, "waits")
    assert watched_rank.watched(1, port).fail(DeuxError("a frame is broken."), "a frame is broken.") is None
    assert ended(leader) == [(1, TOLD)]


def test_a_leading_process_that_is_killed_ends_the_other():
    port = free_port()
    assert ended(start(0, port, "dies"), start(1, port, "waits")) == [(9, ""), (1, NO_LEADER)]


@pytest.fixture
def pair():
    """Two processes' watches over one store, not started: both speak for themselves when they are asked."""
    store = torch.distributed.HashStore()
    return [RankWatch(store, rank, 2, interval=0.01, silence=0.2) for rank in (0, 1)]


def test_all_is_well_as_long_as_all_show_life(pair):
    for beat in range(5):
        assert [watch._check(beat) for watch in pair] == [None, None]
        time.sleep(0.1)


def test_a_process_without_a_sign_of_life_counts_as_dead(pair):
    leader, other = pair
    assert leader._check(0) is None  # it may not have begun
    other._check(0)
    assert leader._check(1) is None
    time.sleep(0.3)
    assert leader._check(2) == "process 1 of the 2 that train together has sent no heartbeat for 0 s."


def test_a_process_that_has_done_its_part_does_not_count_as_dead(pair):
    """As where the leading one evaluates alone, for longer than the silence."""
    leader, other = pair
    other.start()
    while leader._seen.get(1, ("", 0.0))[0] == "":
        assert leader._check(0) is None
    other.stop()
    assert leader._check(1) is None
    time.sleep(0.3)
    assert leader._check(2) is None


@pytest.mark.parametrize("end", ["fail", "interrupt"])
def test_a_process_that_ends_within_a_training_counts_as_dead(pair, monkeypatch, end):
    monkeypatch.setattr(rank_watch, "_PATIENCE", 0.2)
    leader, other = pair
    other.start()
    while leader._seen.get(1, ("", 0.0))[0] == "":
        assert leader._check(0) is None
    if end == "fail":
        other.fail(RuntimeError("[gloo] Connection closed by peer"), "an error of the program")
    else:
        monkeypatch.setattr(rank_failures, "_watch", other)
        EndTogether().on_exception(None, None, KeyboardInterrupt())
    other.stop()
    leader._check(1)
    time.sleep(0.3)
    assert leader._check(2) == "process 1 of the 2 that train together has sent no heartbeat for 0 s."


def test_a_failure_is_found_by_an_operation_that_fails_because_of_it(pair):
    leader, other = pair
    with ThreadPoolExecutor() as pool:
        told = pool.submit(other.fail, DeuxError("a frame is broken."), "a frame is broken.")
        found = leader.fail(RuntimeError("[gloo] Connection closed by peer"), "an error of the program")
        assert told.result(timeout=5) is None  # its own error is the first one
    assert f"deux: {found}" == TOLD


def test_an_operation_that_fails_because_another_process_was_killed(pair, monkeypatch):
    monkeypatch.setattr(rank_watch, "_PATIENCE", 0.2)
    found = pair[0].fail(RuntimeError("[gloo] Connection closed by peer"), "an error of the program")
    assert str(found).startswith("another of the 2 processes that train together has ended without a message")


@pytest.fixture
def killed() -> subprocess.Popen[bytes]:
    """A child process that SIGKILL has ended, as the kernel does when memory is short."""
    child = subprocess.Popen(["sleep", "60"])
    child.kill()
    child.wait(timeout=10)
    return child


def test_a_killed_child_is_named_before_lightning_kills_its_parent(pair, killed):
    """Lightning looks at its children every five seconds, and then sends SIGKILL to all: no message could follow."""
    running = subprocess.Popen(["sleep", "60"])
    try:
        leader = RankWatch(pair[0]._store, 0, 3, children=[running, killed])
        started = time.monotonic()
        found = leader.fail(RuntimeError("[gloo] Connection closed by peer"), "an error of the program")
        assert time.monotonic() - started < 1.0
    finally:
        running.kill()
        running.wait(timeout=10)
    assert str(found) == (
        "process 2 of the 3 that train together was ended by SIGKILL, possibly for lack of memory; the same command "
        "resumes from the last checkpoint."
    )


def test_a_process_that_waits_for_a_killed_child_ends(pair, killed, monkeypatch, capfd):
    codes: list[int] = []
    leader = RankWatch(pair[0]._store, 0, 2, interval=0.01, children=[killed])
    monkeypatch.setattr(rank_watch.os, "_exit", lambda code: (codes.append(code), leader._ending.set()))
    leader.start()
    leader.join(timeout=10)
    assert codes == [1]
    assert capfd.readouterr().err.startswith("deux: process 1 of the 2 that train together was ended by SIGKILL")


def test_a_process_alone_has_nobody_to_tell():
    assert share_failure(DeuxError("a frame is broken."), "a frame is broken.") is None
