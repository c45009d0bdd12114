import pytest

from deux.errors import DeuxError
from deux.options import construct
from deux.training.training_settings import TrainingSettings


@pytest.mark.parametrize("value", [False, True, "default", "reduce-overhead", "max-autotune"])
def test_ways_to_compile(value):
    assert construct(TrainingSettings, {"compile": value}, "training").compile is value


WRONG = [{"compile": "fastest"}, {"tf32": "yes"}, {"betas": [0.9, 1.0]}, {"betas": [-0.1, 0.9]}, {"betas": [0.9]}]


@pytest.mark.parametrize("settings", WRONG)
def test_values_that_mean_nothing_are_refused(settings):
    with pytest.raises(DeuxError, match=rf"training\.{next(iter(settings))}"):
        construct(TrainingSettings, settings, "training")
