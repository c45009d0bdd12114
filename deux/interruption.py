"""Handling of SIGTERM like Ctrl-C, also while Python ignores exceptions."""

import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

_AGAIN_AFTER = 0.1
"""Seconds after which a signal is sent again if its exception was ignored."""


class Terminated(KeyboardInterrupt):
    """The process received SIGTERM; handled like an interrupt by Ctrl-C."""


def interrupt_behind(error: BaseException | None) -> KeyboardInterrupt | None:
    """The innermost interrupt in an error's chain of causes and contexts, or None.

    Libraries may replace an interrupt by an error: what they clean up after it fails in turn, such as the file of an
    unfinished `torch.save`.
    """
    found = None
    while error is not None:
        if isinstance(error, KeyboardInterrupt):
            found = error
        error = error.__cause__ or error.__context__
    return found


@contextmanager
def termination_raised() -> Iterator[None]:
    """Context manager in which SIGTERM raises `Terminated`. Lightning and Ray chain this handler with their own.

    Python ignores exceptions that are raised in destructors and callbacks of weak references. If a signal's exception
    is raised there, the signal is sent again a moment later.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def end(*_: object) -> None:
        raise Terminated

    timers: list[threading.Timer] = []

    def send_again(ignored: Any) -> None:
        if not isinstance(ignored.exc_value, KeyboardInterrupt):
            hook(ignored)
            return
        number = signal.SIGTERM if isinstance(ignored.exc_value, Terminated) else signal.SIGINT
        timer = threading.Timer(_AGAIN_AFTER, os.kill, (os.getpid(), number))
        timer.daemon = True
        timer.start()
        timers.append(timer)

    hook, sys.unraisablehook = sys.unraisablehook, send_again
    earlier = signal.signal(signal.SIGTERM, end)
    try:
        yield
    finally:
        sys.unraisablehook = hook
        for timer in timers:
            timer.cancel()
        signal.signal(signal.SIGTERM, earlier)
