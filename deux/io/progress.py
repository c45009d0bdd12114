"""How long work tells its caller how far it is."""

from typing import Protocol


class Progress(Protocol):
    """Called as `progress(stage, done, total)` whenever something is done; the caller draws the bar."""

    def __call__(self, stage: str, done: int, total: int) -> None:
        """Note that `done` of `total` parts of a stage are done."""


def ignore_progress(stage: str, done: int, total: int) -> None:
    """Show nothing."""
