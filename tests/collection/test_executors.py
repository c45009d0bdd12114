import pytest

from deux.collection.collect_settings import CollectSettings
from deux.collection.executors import make_executor
from deux.collection.local_execution import LocalExecutor
from deux.errors import DeuxError


def test_the_local_executor_takes_the_number_of_processes():
    settings = CollectSettings(steps=3, episodes=1, uncertainty="l1", batch_size=4, processes=3)
    executor = settings.make_executor()
    assert isinstance(executor, LocalExecutor)
    assert executor.processes == 3


@pytest.mark.parametrize(
    ("name", "options", "sentence"),
    [
        ("lokal", {}, "collect.executor cannot be 'lokal': did you mean local?"),
        ("local", {"workers": 2}, "collect.executor_options.workers is not an option of LocalExecutor"),
    ],
)
def test_mistakes_are_reported(name, options, sentence):
    with pytest.raises(DeuxError, match=sentence):
        make_executor(name, options)
