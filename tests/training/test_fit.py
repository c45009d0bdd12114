import pytest

from deux.errors import DeuxError
from deux.options import construct
from deux.training.fit import TrainingSettings, _arithmetic, make_trainer


@pytest.mark.parametrize("value", [False, True, "default", "reduce-overhead", "max-autotune"])
def test_ways_to_compile(value):
    assert construct(TrainingSettings, {"compile": value}, "training").compile is value


@pytest.mark.parametrize("settings", [{"compile": "fastest"}, {"tf32": "yes"}])
def test_values_that_mean_nothing_are_refused(settings):
    with pytest.raises(DeuxError, match=rf"training\.{next(iter(settings))}"):
        construct(TrainingSettings, settings, "training")


def test_the_log_says_what_a_training_computes_with():
    trainer = make_trainer(
        {"accelerator": "cpu", "precision": "bf16-mixed", "logger": False, "enable_checkpointing": False}
    )
    assert _arithmetic(trainer, TrainingSettings()) == (
        "training on 1 x CPU with precision bf16-mixed, float32 convolutions exact, not compiled"
    )
    assert _arithmetic(trainer, TrainingSettings(tf32=True, compile=True)).endswith(
        "float32 convolutions in TensorFloat-32, compiled (default)"
    )
    assert _arithmetic(trainer, TrainingSettings(compile="max-autotune")).endswith("compiled (max-autotune)")
