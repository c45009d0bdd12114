import importlib.util
import sys
from pathlib import Path

import pytest
from lightning.pytorch import Callback

from deux.errors import DeuxError
from deux.training.fit import _graphed, _hardware_and_precision, check_trainer, make_trainer
from deux.training.training_settings import TrainingSettings

# Under a name of its own: another test's copy of this module stays as it is.
_spec = importlib.util.spec_from_file_location("validated_run", Path(__file__).with_name("active_run.py"))
assert _spec is not None
validated_run = sys.modules["validated_run"] = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(validated_run)


def test_the_log_names_what_a_training_computes_with():
    trainer = make_trainer(
        {"accelerator": "cpu", "precision": "bf16-mixed", "logger": False, "enable_checkpointing": False}
    )
    assert _hardware_and_precision(trainer, TrainingSettings()) == (
        "training on 1 x CPU with precision bf16-mixed, float32 convolutions exact, not compiled"
    )
    assert _hardware_and_precision(trainer, TrainingSettings(tf32=True, compile=True)).endswith(
        "float32 convolutions in TensorFloat-32, compiled (default)"
    )
    assert _hardware_and_precision(trainer, TrainingSettings(compile="max-autotune")).endswith(
        "compiled (max-autotune)"
    )


@pytest.mark.parametrize(
    ("settings", "graphed"),
    [({}, True), ({"compile": True}, True), ({"compile": "reduce-overhead"}, False), ({"cuda_graphs": False}, False)],
)
def test_no_graph_is_recorded_inside_another(settings, graphed):
    assert _graphed(TrainingSettings(**settings)) is graphed


class Validations(Callback):
    """The optimiser steps after which there was a validation."""

    def __init__(self):
        self.after = []

    def on_validation_end(self, trainer, pl_module):
        self.after.append(trainer.global_step)


def quiet_training(test):
    """Leave out what Lightning and torch say of a training this small."""
    for ignored in (
        r"ignore:.isinstance\(treespec, LeafSpec\):FutureWarning",
        "ignore:Found 1 module.s. in eval mode",
        "ignore:You have overridden `on_after_batch_transfer`",
        "ignore:.*does not have many workers",
        "ignore:.*is smaller than the logging interval",
        "ignore:Checkpoint directory .* exists and is not empty",
    ):
        test = pytest.mark.filterwarnings(ignored)(test)
    return test


@quiet_training
@pytest.mark.parametrize(
    ("batch_size", "accumulated", "after"),
    [(4, 1, [10, 20]), (4, 4, [10, 20]), (1, 4, [10, 20]), (2, 4, [10, 20])],
)
def test_validations_are_as_many_as_asked_whatever_a_step_takes(tmp_path, batch_size, accumulated, after):
    """Of the twelve frames, an epoch has 3 batches in one step, 12 in three steps, or 6 in two."""
    seen = Validations()
    settings = {"steps": 20, "validations": 2, "batch_size": batch_size}
    trainer = {"accumulate_grad_batches": accumulated}
    validated_run.train(tmp_path, settings, {"every": 999}, trainer, callbacks=[seen], validate=True)
    assert seen.after == after


@quiet_training
@pytest.mark.parametrize(
    ("trainer", "after"),
    [
        ({"check_val_every_n_epoch": 2}, [6, 12, 18]),
        ({"val_check_interval": 1.0}, [3, 6, 9, 12, 15, 18]),
        ({"val_check_interval": 0.67}, [2, 5, 8, 11, 14, 17, 20]),
        ({"val_check_interval": 7}, [7, 14]),
    ],
)
def test_the_trainers_own_options_say_when_validations_come(tmp_path, trainer, after):
    """An epoch has three steps. What is not asked for must not contradict what is."""
    seen = Validations()
    validated_run.train(tmp_path, {"steps": 20}, {"every": 999}, trainer, callbacks=[seen], validate=True)
    assert seen.after == after


class ValidatedFrames(Callback):
    """Counts the frames of each validation."""

    def __init__(self):
        self.counts = []

    def on_validation_start(self, trainer, pl_module):
        self.counts.append(0)

    def on_validation_batch_end(self, trainer, pl_module, outputs, batch, batch_idx):
        self.counts[-1] += len(batch.image)


@quiet_training
def test_a_validation_sees_all_frames(tmp_path):
    """There are twelve, of which one batch would be five."""
    seen = ValidatedFrames()
    settings = {"steps": 4, "validations": 2, "batch_size": 5}
    validated_run.train(tmp_path, settings, {"every": 999}, callbacks=[seen], validate=True)
    assert seen.counts == [12, 12]


@quiet_training
def test_an_interval_that_is_longer_than_the_epoch_it_is_counted_in_is_reported_in_one_sentence(tmp_path):
    trainer = {"check_val_every_n_epoch": 1, "val_check_interval": 7}
    with pytest.raises(DeuxError, match=r"^trainer\.val_check_interval is more batches than an epoch has"):
        validated_run.train(tmp_path, {"steps": 20}, {"every": 999}, trainer, validate=True)


@pytest.mark.parametrize(
    ("settings", "arguments", "sentence"),
    [
        ({}, {"enable_checkpointing": False}, r"^trainer\.enable_checkpointing=false would leave a training that is"),
        ({"steps": None, "averaging": 0.2}, {"max_epochs": -1}, r"^training\.averaging=0\.2 is the last part .* end"),
        ({}, {"max_epoch": 3}, r"^trainer\.max_epoch is not an option"),
        ({}, {"callbacks": []}, r"^trainer\.callbacks takes objects, .*: callbacks=\[early_stopping\] chooses"),
        ({}, {"plugins": None}, r"^trainer\.plugins takes objects"),
        (
            {},
            {"logger": ["csv"]},
            r"^trainer\.logger must be true or false or null, but is \['csv'\]: the other values that",
        ),
    ],
)
def test_what_makes_no_training_is_reported_before_it(settings, arguments, sentence):
    with pytest.raises(DeuxError, match=sentence):
        check_trainer(TrainingSettings(**settings), {"accelerator": "cpu", **arguments})
