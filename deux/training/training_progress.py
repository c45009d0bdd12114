"""The progress of a training, also while frames are added to it (`deux.training.active_collection`)."""

import math
from fractions import Fraction
from typing import NamedTuple

from lightning.pytorch import Trainer


class TrainingProgress(NamedTuple):
    """Optimiser steps done and in total, as if all epochs were as long as the current one.

    Args:
        done: steps done.
        total: steps of the whole training; infinite if it has no end.
    """

    done: int
    total: float

    @property
    def fraction(self) -> float:
        """The fraction of the training that is done, in [0, 1]; 0 if it has no end."""
        return self.done / self.total


def training_progress(trainer: Trainer) -> TrainingProgress:
    """The progress of a training.

    If frames are added, later epochs become longer. The total number of steps of a training in epochs is then unknown
    until its end, but the fraction that is done is known at any time, also right after resuming.

    Args:
        trainer: the training's trainer; before its first batch, no step is done.
    """
    done = trainer.global_step
    total = trainer.max_steps if trainer.max_steps > 0 else math.inf
    batches, epochs = trainer.num_training_batches, trainer.max_epochs or 0
    if epochs > 0 and 0 < batches < math.inf:  # infinite before the frames are listed
        accumulated = trainer.accumulate_grad_batches
        length = math.ceil(batches / accumulated)
        batch = trainer.fit_loop.epoch_loop.batch_idx + 1
        finished = length if batch == batches else batch // accumulated
        in_epochs = trainer.current_epoch * length + finished, epochs * length
        # The training ends at the limit that is reached first.
        if math.isinf(total) or Fraction(*in_epochs) > Fraction(done, int(total)):
            return TrainingProgress(*in_epochs)
    return TrainingProgress(done, total)
