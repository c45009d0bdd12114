"""The learning rate schedule."""

from dataclasses import dataclass
from typing import Literal

from deux.errors import DeuxError, check_range


@dataclass(frozen=True)
class Schedule:
    """A piecewise constant learning rate with an optional linear warm-up.

    The defaults are the paper's 1e-4 for 10 of 25 epochs, then 5e-5, for a run of any length.

    Args:
        learning_rate: the rate that the factors multiply.
        boundaries: where the rate changes, increasing; above 0 and, as fractions, below 1.
        factors: the factor from each boundary on; 1 before the first.
        unit: unit of the boundaries: the fraction of the training that is done, or finished epochs.
        warmup_steps: number of steps at the beginning over which the rate rises linearly.

    Raises:
        DeuxError: the rate is not above 0, or boundaries and factors differ in number.
    """

    learning_rate: float = 1e-4
    boundaries: tuple[float, ...] = (0.4,)
    factors: tuple[float, ...] = (0.5,)
    unit: Literal["fraction", "epoch"] = "fraction"
    warmup_steps: int = 0

    def __post_init__(self) -> None:
        check_range("training.learning_rate", self.learning_rate, 0, ends=False)
        check_range("training.warmup_steps", self.warmup_steps, 0)
        for factor in self.factors:
            check_range("training.factors", factor, 0)
        if len(self.boundaries) != len(self.factors) or list(self.boundaries) != sorted(set(self.boundaries)):
            raise DeuxError(
                f"the learning rate's boundaries {self.boundaries} and factors {self.factors} must be equal in number, "
                "and the boundaries increasing."
            )
        by_epoch = self.unit == "epoch"
        if not all(place >= 1 and place % 1 == 0 if by_epoch else 0 < place < 1 for place in self.boundaries):
            raise DeuxError(
                f"training.boundaries is {list(self.boundaries)}, and with training.unit={self.unit} "
                + (
                    "they count finished epochs, whole numbers from 1 on: training.unit=fraction takes parts of the "
                    "training."
                    if by_epoch
                    else "they are parts of the training, between 0 and 1: training.unit=epoch counts epochs."
                )
            )

    def factor(self, step: int, fraction: float, epoch: int) -> float:
        """The factor of the learning rate in one step.

        Args:
            step: optimiser steps done so far.
            fraction: fraction of the training that is done, in [0, 1]; 0 if it has no end.
            epoch: epochs done so far.
        """
        progress = epoch if self.unit == "epoch" else fraction
        reached = 1.0
        for boundary, factor in zip(self.boundaries, self.factors, strict=True):
            reached = factor if progress >= boundary else reached
        return reached * min(1.0, (step + 1) / (self.warmup_steps + 1))
