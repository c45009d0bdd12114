"""Commands of deux that are started in processes of their own and killed there.

A process is forked from this one, in which the packages that take seconds to import may have been imported already
(`preload`), and runs what `python -m deux` runs. It must be forked from a process of one thread.
"""

import atexit
import gc
import importlib
import os
import runpy
import signal
import sys
import time
import traceback
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

import torch

MOVES = ("replace", "rename")
"""Functions of `os` that move a complete file or folder to its final path."""

_POLL = 0.002
"""Polling interval in seconds."""


@dataclass(frozen=True)
class KillAtMove:
    """SIGKILL to the command and all its processes beside the n-th call of `MOVES` of its main process.

    Args:
        number: n, counted from 1.
        before: whether the kill comes before the call; otherwise it comes after it.
    """

    number: int
    before: bool


@dataclass(frozen=True)
class KillAfter:
    """SIGKILL after some time.

    Args:
        seconds: after the start.
        child: which process gets it: None for the command and all its processes, else the child of that number, modulo
            the number of children that there are; where there is none, the command.
    """

    seconds: float
    child: int | None = None


Kill = KillAtMove | KillAfter


@dataclass(frozen=True)
class Ending:
    """Result of a started command.

    Args:
        code: the exit code, negative for the signal that ended it.
        killed: whether the kill came before the command ended by itself.
        seconds: wall time.
        errors: what it wrote to stderr.
    """

    code: int
    killed: bool
    seconds: float
    errors: str


class Hung(RuntimeError):
    """Raised for a command that exceeded its time limit and was killed."""


def preload(folder: Path, name: str = "command") -> None:
    """Import what a command that ended without a kill had imported, in this process, so that its forks need not.

    Args:
        folder: see `run_command`.
        name: likewise.
    """
    for module in (folder / f"{name}.modules").read_text().split():
        # A library may be importable only inside what it belongs to; a fork imports it as it needs it.
        with suppress(Exception):
            importlib.import_module(module)
    gc.freeze()  # or garbage collection in a fork would copy the memory that it shares with this process


def run_command(
    arguments: Sequence[str], folder: Path, kill: Kill | None = None, patience: float = 600.0, name: str = "command"
) -> Ending:
    """Run `python -m deux ...` in a forked process, on one thread, and wait for its end.

    Args:
        arguments: of the command.
        folder: the working folder, which takes the command's output as `<name>.out` and `<name>.err` as well, and the
            names of the modules that a command without a kill has imported as `<name>.modules`.
        kill: when it is killed; None if it is not.
        patience: seconds after which it is taken to hang.
        name: of the files of the output.

    Raises:
        Hung: it did not end in time, also after one of its children was killed.
    """
    started = time.monotonic()
    pid = os.fork()
    if pid == 0:
        _run_in_fork(arguments, folder, kill, name)
    try:
        code, killed = _wait(pid, kill, started, patience)
    finally:
        _kill_all(pid)  # what a killed command leaves behind must not write on beside the next start
    return Ending(code, killed, time.monotonic() - started, (folder / f"{name}.err").read_text(errors="replace"))


def _wait(pid: int, kill: Kill | None, started: float, patience: float) -> tuple[int, bool]:
    """Wait for a forked process, kill it at its time, and return its exit code and whether it was killed."""
    killed = False
    while (status := _ended(pid)) is None:
        now = time.monotonic() - started
        if now > patience:
            _kill_all(pid)
            os.waitpid(pid, 0)
            raise Hung(f"the command did not end in {patience:.0f} s")
        if isinstance(kill, KillAfter) and not killed and now >= kill.seconds:
            killed = True
            _kill(pid, kill.child)
        time.sleep(_POLL)
    code = os.waitstatus_to_exitcode(status)
    if isinstance(kill, KillAfter):
        return code, killed and (code != 0 or kill.child is not None)
    return code, code == -signal.SIGKILL


def _run_in_fork(arguments: Sequence[str], folder: Path, kill: Kill | None, name: str) -> NoReturn:
    """Main function of the forked process, which does everything that `python -m deux` does."""
    code = 1
    try:
        os.setsid()
        os.chdir(folder)
        for stream, suffix in ((1, "out"), (2, "err")):
            os.dup2(os.open(f"{name}.{suffix}", os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o666), stream)
        atexit._clear()  # of the process that this one was forked from
        torch.set_num_threads(1)
        sys.argv = ["deux", *arguments]
        with _killed_at_move(kill):
            try:
                runpy.run_module("deux", run_name="__main__", alter_sys=True)
                code = 0
            except SystemExit as left:
                code = left.code if isinstance(left.code, int) else int(left.code is not None)
            except BaseException:
                traceback.print_exc()
            if kill is None:
                Path(f"{name}.modules").write_text("\n".join(filter(_is_preloaded, sys.modules)))
            atexit._run_exitfuncs()
        sys.stdout.flush()
        sys.stderr.flush()
    finally:
        os._exit(code)


@contextmanager
def _killed_at_move(kill: Kill | None) -> Iterator[None]:
    """Count the moves of this process, and end it and its group at the one that is asked for."""
    if not isinstance(kill, KillAtMove):
        yield
        return
    done = 0

    def counted(move: Callable[..., None]) -> Callable[..., None]:
        def call(*arguments: Any, **options: Any) -> None:
            nonlocal done
            done += 1
            if kill.before and done == kill.number:
                os.killpg(0, signal.SIGKILL)
            move(*arguments, **options)
            if not kill.before and done == kill.number:
                os.killpg(0, signal.SIGKILL)

        return call

    originals = {name: getattr(os, name) for name in MOVES}
    for name, move in originals.items():
        setattr(os, name, counted(move))
    try:
        yield
    finally:
        for name, move in originals.items():
            setattr(os, name, move)


def _is_preloaded(module: str) -> bool:
    """Whether a module may be imported before the fork: not those that run commands, nor one that starts threads."""
    return "__m" not in module and module.partition(".")[0] not in ("ray", "grpc")


def _ended(pid: int) -> int | None:
    """Status of a child process; None while it runs."""
    found, status = os.waitpid(pid, os.WNOHANG)
    return status if found else None


def _kill(pid: int, child: int | None) -> None:
    children = _children(pid) if child is not None else []
    if not children:
        _kill_all(pid)
        return
    assert child is not None
    with suppress(ProcessLookupError):
        os.kill(children[child % len(children)], signal.SIGKILL)


def _kill_all(pid: int) -> None:
    """Kill the processes of a session's first group."""
    with suppress(ProcessLookupError, PermissionError):
        os.killpg(pid, signal.SIGKILL)


def _children(pid: int) -> list[int]:
    """The processes that one has started and that live (proc(5), fields 3 and 4 of stat)."""
    found = []
    for path in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):
            state, parent = path.read_text().rpartition(")")[2].split()[:2]
            if int(parent) == pid and state not in "ZX":
                found.append(int(path.parent.name))
    return sorted(found)
