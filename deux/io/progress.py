"""The interface for reporting the progress of long work."""

from typing import Protocol


class Progress(Protocol):
    """A callback `progress(stage, done, total)` that is called whenever a part of the work is done."""

    def __call__(self, stage: str, done: int, total: int) -> None:
        """Report that `done` of `total` parts of a stage are done."""


def ignore_progress(stage: str, done: int, total: int) -> None:
    """Do nothing."""
