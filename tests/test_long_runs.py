"""Long runs: memory, open files and threads stop growing, and what is written of each run stays small."""

import os
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import pytest

PROGRAM = Path(__file__).with_name("long_runs.py")

pytestmark = [
    pytest.mark.slow,
    pytest.mark.timeout(7200),
    pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="the system does not tell a process's memory"),
]


class Sample(NamedTuple):
    """What a process used when so much of its work was done."""

    done: int
    memory: float
    files: int
    threads: int


def samples(run: str, number: int, folder: Path) -> list[Sample]:
    """Run the program; it tells of itself twenty times."""
    process = subprocess.run(
        [sys.executable, PROGRAM, run, str(number), folder],
        env=os.environ | {"OMP_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
    )
    assert process.returncode == 0, process.stderr
    lines = [line.split() for line in process.stdout.splitlines() if line[:1].isdecimal()]
    found = [Sample(int(done), float(memory), int(files), int(threads)) for done, memory, files, threads in lines]
    assert len(found) == 20
    assert found[-1].done == number
    return found


def check_bounded(found: list[Sample], growth: float) -> None:
    """After the first quarter, which warms up, memory grows by less than `growth` MiB; files and threads do not."""
    warm, last = found[5], found[-1]
    assert last.memory - warm.memory < growth, found
    assert last.files <= warm.files, found
    assert last.threads <= warm.threads + 1, found  # one that keeps a lock fresh comes and goes


def test_fifty_thousand_frames(tmp_path):
    check_bounded(samples("frames", 50_000, tmp_path), growth=10.0)


def test_twenty_rounds_and_what_they_write(tmp_path):
    check_bounded(samples("rounds", 20, tmp_path), growth=10.0)
    assert len(list(tmp_path.glob("checkpoints/*"))) == 2
    assert sum(path.stat().st_size for path in tmp_path.glob("checkpoints/*")) < 200_000
    (log,) = tmp_path.glob("logs/version_0/metrics.csv")
    assert log.stat().st_size < 20_000


def test_two_hundred_jobs_of_a_sweep_in_one_process(tmp_path):
    """Each job's log has its own lines only."""
    check_bounded(samples("jobs", 200, tmp_path), growth=20.0)
    logs = [path.stat().st_size for path in tmp_path.glob("sweeps/*/*/deux.log")]
    assert len(logs) == 200
    assert max(logs) <= 1.2 * min(logs)
