"""How far a training is, also where the frames become more while it goes on (`deux.training.active_collection`)."""

import math
from fractions import Fraction

from lightning.pytorch import Trainer


def training_progress(trainer: Trainer) -> tuple[int, float]:
    """Optimiser steps done, and those of the whole training if all its epochs are as long as the present one.

    With frames that stay the same these are the true numbers. Frames that are added make later epochs longer, and how
    many steps a training in epochs then has is not known before its end; its part that is done is known at any time,
    also right after it was resumed, and it is the quotient of the two.

    Args:
        trainer: of the training; before its first batch nothing is done.

    Returns:
        Steps done and steps of the whole; infinitely many where the training has no end.
    """
    done, steps = trainer.global_step, math.inf
    if trainer.max_steps > 0:
        steps = trainer.max_steps
    batches, epochs = trainer.num_training_batches, trainer.max_epochs or 0
    if epochs > 0 and 0 < batches < math.inf:  # infinite before the frames are listed
        accumulated = trainer.accumulate_grad_batches
        length = math.ceil(batches / accumulated)
        batch = trainer.fit_loop.epoch_loop.batch_idx + 1
        finished = length if batch == batches else batch // accumulated
        in_epochs = trainer.current_epoch * length + finished, epochs * length
        # Whichever of the two limits comes first ends the training.
        if math.isinf(steps) or Fraction(*in_epochs) > Fraction(done, int(steps)):
            return in_epochs
    return done, steps
