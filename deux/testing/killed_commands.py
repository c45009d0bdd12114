"""Execution of deux commands in separate processes that are killed.

A command runs like `python -m deux` in a process that is forked from this one. To start faster, this process can import
the modules of the command before (`preload`). It must have a single thread.
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
    """SIGKILL to all processes of a command, at the n-th call of a function of `MOVES` in its main process.

    Args:
        number: n, counted from 1.
        before: whether the kill comes before the call; otherwise it comes after it.
    """

    number: int
    before: bool


@dataclass(frozen=True)
class KillAfter:
    """SIGKILL to a command or one of its child processes after some time.

    Args:
        seconds: seconds after the start.
        child: index of the child process to kill, modulo the number of child processes. All processes of the command
            are killed if it is None or if there is no child process.
    """

    seconds: float
    child: int | None = None


Kill = KillAtMove | KillAfter


@dataclass(frozen=True)
class Ending:
    """Result of a command.

    Args:
        code: exit code; the negative number of the signal if a signal ended it.
        killed: whether a process was killed before the command ended.
        seconds: wall time.
        errors: output to stderr.
    """

    code: int
    killed: bool
    seconds: float
    errors: str


class Hung(RuntimeError):
    """Raised for a command that exceeded its time limit and was killed."""


def preload(folder: Path, name: str = "command") -> None:
    """Import the modules of a command in this process, so that forked processes need not import them.

    Args:
        folder: folder in which `run_command` ran the command without a kill.
        name: the `name` of that call.
    """
    for module in (folder / f"{name}.modules").read_text().split():
        # Some modules can only be imported by their package; the forked process imports them.
        with suppress(Exception):
            importlib.import_module(module)
    gc.freeze()  # otherwise garbage collection in a fork would copy shared memory


def run_command(
    arguments: Sequence[str], folder: Path, kill: Kill | None = None, patience: float = 600.0, name: str = "command"
) -> Ending:
    """Run `python -m deux ...` in a forked process with one torch thread and wait until it ends.

    Args:
        arguments: arguments of the command.
        folder: working folder. The output is written to `<name>.out` and `<name>.err`, and without a kill the names of
            the imported modules to `<name>.modules`.
        kill: when to kill the command; None for no kill.
        patience: time limit in seconds.
        name: stem of the names of the output files.

    Returns:
        The result of the command.

    Raises:
        Hung: the command exceeded the time limit.
    """
    started = time.monotonic()
    pid = os.fork()
    if pid == 0:
        _run_in_fork(arguments, folder, kill, name)
    try:
        code, killed = _wait(pid, kill, started, patience)
    finally:
        _kill_all(pid)  # remaining processes must not write files during the next start
    return Ending(code, killed, time.monotonic() - started, (folder / f"{name}.err").read_text(errors="replace"))


def _wait(pid: int, kill: Kill | None, started: float, patience: float) -> tuple[int, bool]:
    """Wait for a forked process, kill it if requested, and return its exit code and whether it was killed."""
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
    """Main function of the forked process; runs `python -m deux`."""
    code = 1
    try:
        os.setsid()
        os.chdir(folder)
        for stream, suffix in ((1, "out"), (2, "err")):
            os.dup2(os.open(f"{name}.{suffix}", os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o666), stream)
        atexit._clear()  # removes the functions of the parent process
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
    """Kill the process group at the requested call of `MOVES` in this process."""
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
    """Whether a module can be imported before the fork: it neither runs a command nor starts threads."""
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
    """Kill all processes of a process group."""
    with suppress(ProcessLookupError, PermissionError):
        os.killpg(pid, signal.SIGKILL)


def _children(pid: int) -> list[int]:
    """Running child processes of a process, from fields 3 and 4 of /proc/PID/stat (proc(5))."""
    found = []
    for path in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):
            state, parent = path.read_text().rpartition(")")[2].split()[:2]
            if int(parent) == pid and state not in "ZX":
                found.append(int(path.parent.name))
    return sorted(found)
