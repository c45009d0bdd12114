"""The rounds of active collection: when they come, what each process is asked for and what they make together."""

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

from deux.contracts import DepthModel
from deux.errors import DeuxError, check_range

_WHERE = "callbacks.active_collection"


@dataclass(frozen=True)
class RoundSettings:
    """When the model that is being trained explores again, and what becomes of the frames.

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
        check_range(f"{_WHERE}.every", self.every, 0, ends=False)
        check_range(f"{_WHERE}.rounds", self.rounds, 1)
        if self.unit == "fraction" and self.every >= 1:
            raise DeuxError(
                f"{_WHERE}.every={self.every:g} never comes: with {_WHERE}.unit=fraction it is a part of the training, "
                f"below 1; {_WHERE}.unit=epoch counts epochs."
            )

    def due(self, number: int, epochs: int, fraction: float) -> bool:
        """Whether it is time for a round.

        Args:
            number: of the round, from 1.
            epochs: epochs done so far.
            fraction: part of the training that is done, in [0, 1].
        """
        done = epochs if self.unit == "epoch" else fraction
        return number <= self.rounds and fraction < 1 and done >= number * self.every * (1 - 1e-9)


def check_reloading(epochs: Any) -> None:
    """Raise DeuxError if the trainer would not read its frames anew in each epoch.

    Args:
        epochs: `trainer.reload_dataloaders_every_n_epochs`.
    """
    if epochs != 1:
        raise DeuxError(
            f"trainer.reload_dataloaders_every_n_epochs={epochs} would leave out frames that are collected during the "
            f"training: with {_WHERE} it has to be 1."
        )


@dataclass(frozen=True)
class RoundRequest:
    """What a process is asked to collect in a round.

    Args:
        number: of the round, from 1.
        step: optimiser steps done so far.
        model: the model as it is now, in eval mode on its device; it must not be changed.
        precision: the precision that the model trains in, by Lightning's name.
        rank: number of this process among those that train together; it explores scenes[rank::world_size].
        world_size: number of processes that train together.
    """

    number: int
    step: int
    model: DepthModel
    precision: str
    rank: int = 0
    world_size: int = 1


@dataclass(frozen=True)
class RankResult:
    """What one process has collected in a round.

    Args:
        dataset: folder of the dataset, complete; None if there was no scene left for this process.
        frames: number of frames to train on.
        area: square metres of floor plan seen; what several of its episodes see counts once.
        uncertainty: mean of Eq. 8 over the frames that have one; None without any.
        mae: validation error in mm of the model that explored; None where it was not measured or is not finite.
    """

    dataset: Path | None
    frames: int = 0
    area: float = 0.0
    uncertainty: float | None = None
    mae: float | None = None


@dataclass(frozen=True)
class Round:
    """A round that is complete: the results of all processes in one.

    Args:
        round: its number, from 1.
        step: optimiser steps before it.
        frames: frames to train on that it brought.
        area: square metres of floor plan seen; what several of its episodes see counts once.
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
        """Its values for reports: all but the folders."""
        return {name: value for name, value in asdict(self).items() if name != "datasets"}


def merge_results(request: RoundRequest, results: Sequence[RankResult], folder: Path) -> Round:
    """Merge the results of all processes to a round; the uncertainty is weighted by the number of frames.

    Args:
        request: what was asked of any of the processes.
        results: what they have collected, by rank.
        folder: of the datasets of all rounds.
    """
    known = [(result.uncertainty, result.frames) for result in results if result.uncertainty is not None]
    weight = sum(frames for _, frames in known)
    return Round(
        round=request.number,
        step=request.step,
        frames=sum(result.frames for result in results),
        area=math.fsum(result.area for result in results),
        uncertainty=sum(value * frames for value, frames in known) / weight if weight else None,
        mae=next((result.mae for result in results if result.mae is not None), None),
        datasets=[str(result.dataset.relative_to(folder)) for result in results if result.dataset is not None],
    )
