"""Warnings that a process logs only once, although the code that gives them runs several times."""

import functools
import logging


@functools.cache
def warn_once(log: logging.Logger, message: str) -> None:
    """Log a warning, unless this process has already logged the same message to the same logger."""
    log.warning("%s", message)
