import subprocess
import sys
from contextlib import nullcontext

import pytest
import torch
from lightning.pytorch import Callback
from lightning.pytorch.loggers import CSVLogger

from deux import callbacks
from deux.callbacks import (
    ACTIVE_COLLECTION,
    CALLBACKS,
    callback_names,
    check_monitor,
    lightning_object,
    make_callback,
)
from deux.errors import DeuxError
from deux.testing.losses import perfect_sample
from deux.training.module import DepthCompletion
from deux.training.objective import make_objective

REQUIRED = {"early_stopping": {"monitor": "validation/loss"}}
"""A value for each option that has no default."""


@pytest.fixture(autouse=True)
def every_package(monkeypatch):
    """No callback's package counts as missing."""
    monkeypatch.setattr(callbacks, "find_spec", lambda package: package)


@pytest.mark.parametrize("name", CALLBACKS)
def test_each_is_made_with_its_defaults_or_names_the_option_that_it_needs(name):
    if name in REQUIRED:
        (option,) = REQUIRED[name]
        with pytest.raises(DeuxError, match=rf"needs a value for callbacks\.{name}\.{option}\."):
            make_callback(name, {})
    made = make_callback(name, REQUIRED.get(name, {}))
    words = [word.capitalize() for word in name.split("_")]
    assert type(made).__name__ in ("".join(words), words[0].upper() + "".join(words[1:]))
    assert isinstance(made, Callback)


def test_a_package_that_is_missing_is_named(monkeypatch):
    monkeypatch.setattr(callbacks, "find_spec", lambda package: None)
    with pytest.raises(DeuxError, match=r"callbacks\.device_stats_monitor needs the package psutil: install it"):
        make_callback("device_stats_monitor", {})


@pytest.mark.filterwarnings("ignore:You're using the WeightAveraging callback")
@pytest.mark.filterwarnings("ignore:.*does not have many workers")
@pytest.mark.filterwarnings("ignore:When using the `ThroughputMonitor`")
@pytest.mark.parametrize("name", CALLBACKS)
def test_each_works_in_a_training(name, small_model, fit, tmp_path):
    if name == "device_stats_monitor":
        pytest.importorskip("psutil")
    torch.manual_seed(0)
    model = small_model()
    trainer = fit(
        DepthCompletion(model, make_objective(model)),
        perfect_sample(1, 16, 16).batch,
        copies=2,
        max_epochs=2,
        limit_val_batches=1,
        log_every_n_steps=1,
        logger=CSVLogger(tmp_path),
        enable_checkpointing=True,
        enable_model_summary="summary" in name,
        callbacks=[make_callback(name, REQUIRED.get(name, {}))],
    )
    assert trainer.global_step == 4


QUANTITIES = ["train/loss", "validation/loss"]


@pytest.mark.parametrize(
    ("name", "settings", "known"),
    [
        ("early_stopping", {"monitor": "val_loss"}, False),
        ("early_stopping", {"monitor": "val_loss", "strict": False}, True),
        ("early_stopping", {"monitor": "validation/loss"}, True),
        ("model_checkpoint", {"monitor": "validation/los"}, False),
        ("model_checkpoint", {"monitor": "step", "mode": "max"}, True),
        ("model_checkpoint", {}, True),
        ("timer", {}, True),
    ],
)
def test_a_quantity_that_no_training_logs_is_reported(name, settings, known):
    made = make_callback(name, settings)
    sentence = rf"callbacks\.{name}\.monitor=\S+ is not logged by this training: did you mean .*validation/loss"
    with nullcontext() if known else pytest.raises(DeuxError, match=sentence):
        check_monitor(name, made, QUANTITIES)


def test_names_are_known_without_lightning_and_torch():
    program = (
        "import sys; from deux.callbacks import callback_names; print(*callback_names());"
        "assert not {'torch', 'lightning', 'pytorch_lightning'} & set(sys.modules), 'imported'"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == callback_names() == sorted([*CALLBACKS, ACTIVE_COLLECTION])


def test_options_reach_the_callback():
    made = make_callback("early_stopping", {"monitor": "validation/mae", "patience": 7, "min_delta": 1})
    assert (made.monitor, made.patience, made.min_delta) == ("validation/mae", 7, -1.0)


@pytest.mark.parametrize(
    ("name", "settings", "sentence"),
    [
        (
            "early_stoping",
            {},
            r"there is no callback called 'early_stoping': did you mean early_stopping\? There is: active_c",
        ),
        (
            "early_stopping",
            {"monitr": "loss"},
            r"callbacks\.early_stopping\.monitr is not an option of EarlyStopping: did",
        ),
        (
            "early_stopping",
            {"monitor": "loss", "mode": "lowest"},
            r"EarlyStopping refuses the settings under callbacks\.early_stopping: .*mode",
        ),
        (
            "early_stopping",
            {"monitor": "loss", "patience": "long"},
            r"callbacks\.early_stopping\.patience must be a whole",
        ),
        ("learning_rate_monitor", {"logging_interval": "hour"}, r"callbacks\.learning_rate_monitor"),
        (
            "model_checkpoint",
            {"train_time_interval": "00:10:00"},
            r"callbacks\.model_checkpoint\.train_time_interval must be null, but is '00:10:00': the other values that",
        ),
        ("throughput_monitor", {"length_fn": "len"}, r"callbacks\.throughput_monitor\.length_fn must be null"),
    ],
)
def test_what_makes_no_callback(name, settings, sentence):
    with pytest.raises(DeuxError, match=sentence) as raised:
        make_callback(name, settings)
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize(
    "complaint", ["No supported backend found!", "No supported backend\n found.", "No supported backend found"]
)
def test_lightnings_complaint_becomes_one_sentence(complaint):
    def trainer() -> None:
        raise RuntimeError(complaint)

    with pytest.raises(DeuxError) as raised:
        lightning_object(trainer, {}, "trainer")
    assert str(raised.value) == "lightning.trainer refuses the settings under trainer: No supported backend found."
