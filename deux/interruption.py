"""SIGTERM ends a command as Ctrl-C does, and neither is lost where Python drops what is raised."""

import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

_AGAIN_AFTER = 0.1
"""Seconds after which a signal is sent again that came where it could end nothing."""


class Terminated(KeyboardInterrupt):
    """The process was asked by SIGTERM to end: what works on ends as it does at Ctrl-C."""


@contextmanager
def termination_raised() -> Iterator[None]:
    """Let SIGTERM end what happens inside as Ctrl-C does. Lightning and Ray keep this handler beside their own.

    A signal that comes while a destructor or the callback of a weak reference runs raises there, and Python drops what
    these raise: it is sent again a moment later.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def end(*_: object) -> None:
        raise Terminated

    waiting: list[threading.Timer] = []

    def send_again(dropped: Any) -> None:
        if not isinstance(dropped.exc_value, KeyboardInterrupt):
            hook(dropped)
            return
        number = signal.SIGTERM if isinstance(dropped.exc_value, Terminated) else signal.SIGINT
        timer = threading.Timer(_AGAIN_AFTER, os.kill, (os.getpid(), number))
        timer.daemon = True
        timer.start()
        waiting.append(timer)

    hook, sys.unraisablehook = sys.unraisablehook, send_again
    earlier = signal.signal(signal.SIGTERM, end)
    try:
        yield
    finally:
        sys.unraisablehook = hook
        for timer in waiting:
            timer.cancel()
        signal.signal(signal.SIGTERM, earlier)
