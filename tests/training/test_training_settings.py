import pytest

from deux.errors import DeuxError
from deux.options import construct
from deux.training.training_settings import TrainingSettings


@pytest.mark.parametrize("value", [False, True, "default", "reduce-overhead", "max-autotune"])
def test_ways_to_compile(value):
    assert construct(TrainingSettings, {"compile": value}, "training").compile is value


@pytest.mark.parametrize("settings", [{"compile": "fastest"}, {"tf32": "yes"}])
def test_values_that_mean_nothing_are_refused(settings):
    with pytest.raises(DeuxError, match=rf"training\.{next(iter(settings))}"):
        construct(TrainingSettings, settings, "training")
