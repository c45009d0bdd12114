"""Torch's threads wait asleep: what the environment says, and that it is said before torch is there."""

import os
import subprocess
import sys

import pytest

from deux.thread_waiting import SPIN_SETTINGS, SPINS, let_waiting_threads_sleep

IN_A_TASK = """
import os, sys, types
task = types.ModuleType("deux.tasks.train")
task.run = lambda cfg: print(os.environ["GOMP_SPINCOUNT"])
sys.modules["deux.tasks.train"] = task
import deux.__main__
set_it = deux.__main__.let_waiting_threads_sleep
deux.__main__.let_waiting_threads_sleep = lambda: (set_it(), print("torch" in sys.modules))
sys.exit(deux.__main__.main())
"""

WAITS = """
import time
from deux.thread_waiting import let_waiting_threads_sleep
let_waiting_threads_sleep()
import torch
torch.set_num_threads(2)
values = torch.rand(1_000_000)
values.add(1.0)
spent = 0.0
for _ in range(50):
    values.add(1.0)  # after which the second thread waits for the next loop
    start = time.process_time()
    time.sleep(0.004)  # a thread that never sleeps takes all of it, with the default on an idle machine nearly all
    spent += time.process_time() - start
print(spent / (50 * 0.004))
"""


def output(program: str, *arguments: str) -> str:
    environment = {name: value for name, value in os.environ.items() if not name.startswith(("OMP_", "GOMP_"))}
    command = [sys.executable, "-c", program, *arguments]
    return subprocess.run(command, env=environment, capture_output=True, text=True, timeout=120, check=True).stdout


@pytest.fixture
def unset(monkeypatch: pytest.MonkeyPatch) -> pytest.MonkeyPatch:
    for name in SPIN_SETTINGS:
        monkeypatch.delenv(name, raising=False)
    return monkeypatch


def test_the_time_that_threads_spin_is_bounded(unset: pytest.MonkeyPatch) -> None:
    unset.setenv("GOMP_SPINCOUNT", "")  # so that it is put back afterwards
    unset.delenv("GOMP_SPINCOUNT")
    let_waiting_threads_sleep()
    assert 0 < int(os.environ["GOMP_SPINCOUNT"]) <= 10_000


@pytest.mark.parametrize(("name", "value"), [("GOMP_SPINCOUNT", "5"), ("OMP_WAIT_POLICY", "active")])
def test_what_the_user_has_set_stays(unset: pytest.MonkeyPatch, name: str, value: str) -> None:
    unset.setenv(name, value)
    let_waiting_threads_sleep()
    assert {key: os.environ[key] for key in SPIN_SETTINGS if key in os.environ} == {name: value}


def test_the_command_sets_it_before_torch_is_imported(tmp_path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert output(IN_A_TASK, "task=train", "explore=random").split() == ["False", str(SPINS)]


@pytest.mark.skipif(len(os.sched_getaffinity(0)) < 2, reason="one core has no second thread to wait")
def test_a_thread_that_waits_for_long_sleeps_most_of_the_time() -> None:
    assert float(output(WAITS)) < 0.3
