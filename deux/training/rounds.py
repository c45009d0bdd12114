"""The rounds of active collection: when they come, what is asked for and what comes of it."""

import math
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

from deux.contracts import DepthModel
from deux.errors import DeuxError, check_range


@dataclass(frozen=True)
class RoundSettings:
    """When the model explores again, and what becomes of the frames.

    A round comes at the end of an epoch: until then every frame is shown once, the newest included, and from there a
    killed run goes on.

    Args:
        every: distance of the rounds, in units; round k comes with the first epoch that ends at k times this or later.
        unit: what `every` counts: epochs, or the fraction of the training that is done.
        rounds: number of rounds at most; none comes when the training is over.
        mode: whether a round's frames are added to those before or replace them.

    Raises:
        DeuxError: a value is out of its range.
    """

    every: float = 1.0
    unit: Literal["epoch", "fraction"] = "epoch"
    rounds: int = 3
    mode: Literal["add", "replace"] = "add"

    def __post_init__(self) -> None:
        check_range("callbacks.every", self.every, 0, ends=False)
        check_range("callbacks.rounds", self.rounds, 1)
        if self.unit == "fraction" and self.every >= 1:
            raise DeuxError(
                f"callbacks.every={self.every:g} never comes: with callbacks.unit=fraction it is a part of the "
                "training, below 1; callbacks.unit=epoch counts epochs."
            )

    def due(self, number: int, epochs: int, fraction: float) -> bool:
        """Whether a round's time has come.

        Args:
            number: of the round, from 1.
            epochs: epochs done so far.
            fraction: part of the training that is done.
        """
        done = epochs if self.unit == "epoch" else fraction
        return number <= self.rounds and fraction < 1 and done >= number * self.every * (1 - 1e-9)


@dataclass(frozen=True)
class RoundRequest:
    """What is asked of whoever collects a round.

    Args:
        number: of the round, from 1.
        step: optimiser steps done so far.
        model: the model as it is now, in eval mode on its device; it must not be changed.
        precision: the arithmetic that the model trains in, by Lightning's name.
        context: makes the context in which the model has to be called for that arithmetic.
        share: the part of the scenes that this process explores, from 0.
        shares: number of parts.
    """

    number: int
    step: int
    model: DepthModel
    precision: str
    context: Callable[[], AbstractContextManager[Any]]
    share: int = 0
    shares: int = 1


@dataclass(frozen=True)
class Share:
    """What one process has collected in a round.

    Args:
        dataset: folder of the dataset, complete; None if there was no scene left for this process.
        frames: number of frames to train on.
        area: square metres of floor plan seen, summed over the episodes.
        uncertainty: mean of Eq. 8 over the frames that have one; None without any.
        mae: validation error in mm of the model that explored; None where it was not measured.
    """

    dataset: Path | None
    frames: int = 0
    area: float = 0.0
    uncertainty: float | None = None
    mae: float | None = None


@dataclass(frozen=True)
class Round:
    """What is known of a round.

    Args:
        round: its number, from 1.
        step: optimiser steps before it.
        frames: frames to train on that it brought.
        area: square metres of floor plan seen, summed over its episodes.
        uncertainty: mean of Eq. 8 on the robots' way; None for an explorer that asks for no model.
        mae: validation error in mm of the model that explored; None without validation frames.
        datasets: the folders of its frames, relative to the folder of all rounds.
    """

    round: int
    step: int
    frames: int
    area: float
    uncertainty: float | None
    mae: float | None
    datasets: Sequence[str]

    def summary(self) -> dict[str, Any]:
        """What is reported of it: all but the folders."""
        return {name: value for name, value in asdict(self).items() if name != "datasets"}


def together(request: RoundRequest, shares: Sequence[Share], folder: Path) -> Round:
    """The round that the shares of all processes make, in the order of the processes.

    Args:
        request: what was asked of any of them.
        shares: what each has collected.
        folder: of the datasets of all rounds.
    """
    looks = [(share.uncertainty, share.frames) for share in shares if share.uncertainty is not None]
    weight = sum(frames for _, frames in looks)
    return Round(
        round=request.number,
        step=request.step,
        frames=sum(share.frames for share in shares),
        area=math.fsum(share.area for share in shares),
        uncertainty=sum(value * frames for value, frames in looks) / weight if weight else None,
        mae=next((share.mae for share in shares if share.mae is not None), None),
        datasets=[str(share.dataset.relative_to(folder)) for share in shares if share.dataset is not None],
    )
