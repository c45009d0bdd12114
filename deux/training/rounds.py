"""The rounds of active collection: their settings, each process's request and result, and the merged result."""

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
    """When the model collects frames during training, and how they are used.

    Rounds take place at the end of epochs, so that every frame, also of the last round, has been used once, and since
    killed trainings resume from there.

    Args:
        every: interval of the rounds; round k takes place at the end of the first epoch that ends at k times this or
            later.
        unit: unit of `every`: epochs, or the fraction of the training that is done.
        rounds: maximal number of rounds; none takes place at the end of the training.
        mode: whether a round's frames are added to earlier frames or replace them.

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
                f"{_WHERE}.every={self.every:g} is never reached: with {_WHERE}.unit=fraction it is a part of the "
                f"training, below 1; {_WHERE}.unit=epoch counts epochs."
            )
        if self.unit == "epoch" and self.every < 1:
            raise DeuxError(
                f"{_WHERE}.every={self.every:g} is less than an epoch, and rounds take place at the end of epochs: "
                f"with {_WHERE}.unit=fraction it is a part of the training."
            )

    def due(self, number: int, epochs: int, fraction: float) -> bool:
        """Whether a round is due.

        Args:
            number: number of the round, from 1.
            epochs: epochs done so far.
            fraction: fraction of the training that is done, in [0, 1].
        """
        done = epochs if self.unit == "epoch" else fraction
        return number <= self.rounds and fraction < 1 and done >= number * self.every * (1 - 1e-9)


def check_reloading(epochs: Any) -> None:
    """Raise DeuxError if the trainer would not reload its data in each epoch.

    Args:
        epochs: `trainer.reload_dataloaders_every_n_epochs`.
    """
    if epochs != 1:
        raise DeuxError(
            f"trainer.reload_dataloaders_every_n_epochs={epochs} would ignore frames that are collected during the "
            f"training: with {_WHERE} it must be 1."
        )


@dataclass(frozen=True)
class RoundRequest:
    """What a process collects in a round.

    Args:
        number: number of the round, from 1.
        step: optimiser steps done so far.
        model: the current model, in eval mode on its device; it must not be modified.
        precision: the precision that the model trains in, by Lightning's name.
        rank: rank of this process among those that train together; it explores scenes[rank::world_size].
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
    """The result of one process in a round.

    Args:
        dataset: folder of the completed dataset; None if there was no scene for this process.
        frames: number of training frames.
        area: square metres of floor plan seen, each counted once.
        uncertainty: mean of Eq. 8 over the frames that have a value; None without any.
        mae: validation error in mm of the exploring model; None if it was not measured or is not finite.
    """

    dataset: Path | None
    frames: int = 0
    area: float = 0.0
    uncertainty: float | None = None
    mae: float | None = None


@dataclass(frozen=True)
class Round:
    """A completed round: the merged results of all processes.

    Args:
        round: its number, from 1.
        step: optimiser steps before it.
        frames: number of new training frames.
        area: square metres of floor plan seen, each counted once.
        uncertainty: mean of Eq. 8 along the robots' paths; None for an explorer that uses no model.
        mae: validation error in mm of the exploring model; None without validation frames.
        datasets: folders of its frames, relative to the folder of all rounds.
    """

    round: int
    step: int
    frames: int
    area: float
    uncertainty: float | None
    mae: float | None
    datasets: Sequence[str]

    def summary(self) -> dict[str, Any]:
        """Its values without the folders, for reports."""
        return {name: value for name, value in asdict(self).items() if name != "datasets"}


def merge_results(request: RoundRequest, results: Sequence[RankResult], folder: Path) -> Round:
    """Merge the results of all processes; uncertainties are weighted by the number of frames.

    Args:
        request: the request to any of the processes.
        results: the processes' results, by rank.
        folder: folder of the datasets of all rounds.
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
