"""What the machine does not have or allow, made to happen where that is quick, else in torch's words."""

import errno
import multiprocessing
import os
import resource
from pathlib import Path

import pytest

from deux.machine_failures import ended_by_sigterm, machine_failure


def told(error: BaseException, folder: Path | None = None) -> str:
    sentence = machine_failure(error, folder)
    assert sentence is not None
    return sentence


def test_a_loop_of_links_and_a_long_name_are_no_files(tmp_path: Path) -> None:
    (tmp_path / "loop").symlink_to("loop")
    for name, reason in (("loop", "Too many levels of symbolic links"), ("a" * 300, "File name too long")):
        with pytest.raises(OSError, match=reason) as caught:
            (tmp_path / name / "x").read_bytes()
        assert told(caught.value) == f"{tmp_path / name / 'x'} cannot be used: {reason}."


def test_too_many_open_files(tmp_path: Path) -> None:
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    files = []
    try:
        resource.setrlimit(resource.RLIMIT_NOFILE, (min(64, soft), hard))
        with pytest.raises(OSError, match="Too many open files") as caught:
            files.extend((tmp_path / "file").open("a") for _ in range(100))
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))
        for file in files:
            file.close()
    assert "ulimit -n" in told(caught.value)


def test_locks_of_processes_without_shared_memory(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr("multiprocessing.synchronize._multiprocessing.SemLock", full)
    with pytest.raises(OSError, match="No space left") as caught:
        multiprocessing.get_context("fork").Lock()
    assert told(caught.value, tmp_path).startswith("processes cannot share memory in /dev/shm, No space left on device")


def test_a_place_that_takes_no_files(tmp_path: Path) -> None:
    error = OSError(errno.EROFS, os.strerror(errno.EROFS))
    assert told(error, tmp_path) == f"{tmp_path} cannot be written: Read-only file system."
    assert told(error).startswith("the run folder cannot be written, Read-only file system")


@pytest.mark.parametrize(
    ("message", "sentence"),
    [
        (
            "DataLoader worker (pid 5) is killed by signal: Bus error. It is possible that dataloader's workers are "
            "out of shared memory. Please try to raise your shared memory limit.",
            "the processes that load frames have too little shared memory in /dev/shm: ",
        ),
        (
            "unable to open shared memory object </torch_1_2_3> in read-write mode",
            "the processes that load frames have",
        ),
        ("DataLoader worker (pid 7) is killed by signal: Killed. ", "a process that loads frames has been killed by "),
        ("DataLoader worker (pid(s) 7, 8) exited unexpectedly", "a process that loads frames has exited unexpectedly"),
    ],
)
def test_messages_of_torch_about_processes_that_load_frames(message: str, sentence: str) -> None:
    assert told(RuntimeError(message)).startswith(sentence)
    assert not ended_by_sigterm(RuntimeError(message))


def test_a_loader_that_got_sigterm_with_the_command() -> None:
    assert ended_by_sigterm(RuntimeError("DataLoader worker (pid 10555) is killed by signal: Terminated. "))


def test_other_errors_are_the_programs() -> None:
    for error in (RuntimeError("mat1 and mat2 shapes"), ValueError("x"), OSError(errno.EINVAL, "x"), KeyError("x")):
        assert machine_failure(error, None) is None
