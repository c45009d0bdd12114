import math
from types import SimpleNamespace

import pytest

from deux.training.training_progress import training_progress


def trainer(step=0, max_steps=-1, epoch=0, max_epochs=-1, batch=-1, batches=math.inf, accumulated=1):
    return SimpleNamespace(
        global_step=step,
        max_steps=max_steps,
        current_epoch=epoch,
        max_epochs=max_epochs,
        num_training_batches=batches,
        accumulate_grad_batches=accumulated,
        fit_loop=SimpleNamespace(epoch_loop=SimpleNamespace(batch_idx=batch)),
    )


def test_a_training_in_steps():
    assert training_progress(trainer(step=7, max_steps=10, epoch=3, batch=0, batches=2)) == (7, 10)


def test_a_training_in_epochs_of_one_length():
    found = [
        training_progress(trainer(step=3 * epoch + batch + 1, max_epochs=4, epoch=epoch, batch=batch, batches=3))
        for epoch in range(4)
        for batch in range(3)
    ]
    assert found == [(step, 12) for step in range(1, 13)]


def test_epochs_that_become_longer_are_equal_parts():
    """Three batches, then six, then nine: after the first of three epochs a third is done."""
    parts = [
        done / steps
        for epoch, batches in enumerate((3, 6, 9))
        for done, steps in [
            training_progress(trainer(99, max_epochs=3, epoch=epoch, batch=batch, batches=batches))
            for batch in range(batches)
        ]
    ]
    assert parts == sorted(parts)
    assert [parts[2], parts[8], parts[17]] == pytest.approx([1 / 3, 2 / 3, 1])
    assert parts[5] == pytest.approx(0.5)


def test_gradients_that_are_accumulated_make_a_step_at_the_end_of_an_epoch():
    """Of five batches the steps are after the second, the fourth and the last."""
    found = [training_progress(trainer(max_epochs=2, batch=batch, batches=5, accumulated=2)) for batch in range(5)]
    assert found == [(done, 6) for done in (0, 1, 1, 2, 3)]


def test_the_limit_that_comes_first_counts():
    both = {"max_epochs": 4, "epoch": 1, "batch": 2, "batches": 3, "step": 6}
    assert training_progress(trainer(**both, max_steps=100)) == (6, 12)
    assert training_progress(trainer(**both, max_steps=8)) == (6, 8)


def test_nothing_is_done_before_the_first_batch_nor_ever_without_an_end():
    assert training_progress(trainer(max_epochs=4)) == (0, math.inf)
    assert training_progress(trainer(step=7, epoch=2, batch=0, batches=3)) == (7, math.inf)
