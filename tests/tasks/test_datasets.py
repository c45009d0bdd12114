"""What is asked of a source's scenes before any of them is explored."""

from dataclasses import dataclass

import pytest

from deux.configuration import compose, sections_of
from deux.contracts import SceneReference, SceneSource, SceneSplits
from deux.errors import DeuxError
from deux.registry import registry
from deux.tasks.datasets import read_scenes


@dataclass(frozen=True)
class Numbered(SceneReference):
    @property
    def identity(self) -> str:
        return self.name


class Careless(SceneSource):
    """Gives every split the first scenes."""

    def __init__(self, train: int = 2, validation: int = 0, test: int = 1, allow_overlap: bool = False) -> None:
        self.counts = (train, validation, test)

    def splits(self) -> SceneSplits:
        return SceneSplits(*(tuple(Numbered(f"scene-{i}") for i in range(count)) for count in self.counts))


def test_a_scene_in_two_splits_is_refused_unless_an_option_of_the_source_allows_it():
    registry().register("scenes", "careless", Careless)
    try:
        counts = ["scenes=careless", "scenes.train=2", "scenes.validation=0"]
        with pytest.raises(
            DeuxError, match=r"^the scene scene-0 is in scenes\.train and in scenes\.test: it must be in"
        ):
            read_scenes(sections_of(compose([*counts, "scenes.test=1"])), ["train"])
        allowed = compose([*counts, "scenes.test=1", "scenes.allow_overlap=true"])
        assert len(read_scenes(sections_of(allowed), ["train"]).test) == 1
        assert len(read_scenes(sections_of(compose([*counts, "scenes.test=0"])), ["train"]).train) == 2
    finally:
        registry().unregister("scenes", "careless")
