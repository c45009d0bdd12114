import pytest

from deux.contracts import SceneSource
from deux.errors import DeuxError
from deux.testing.scenes import SceneSourceSuite
from deux_plugins.scenes.apartments import Apartments
from deux_plugins.scenes.houses import Houses
from deux_plugins.scenes.interiors import Interiors


class TestInteriors(SceneSourceSuite):
    def make_source(self) -> SceneSource:
        return Interiors(train=2, validation=0, test=2, houses=0.5)


def test_the_scenes_are_those_of_both_sources():
    mixed = Interiors(train=10, validation=2, test=5, houses=0.4, draw=3).splits()
    flats = Apartments(6, 1, 3, draw=3).splits()
    houses = Houses(4, 1, 2, draw=3).splits()
    for split in ("train", "validation", "test"):
        assert getattr(mixed, split) == getattr(flats, split) + getattr(houses, split)


def test_further_scenes_are_of_both_kinds_and_none_of_those_left_out():
    source = Interiors(houses=0.5)
    first = source.further(4, set())
    names = [scene.name.split("_")[0] for scene in first]
    assert names == ["apartment", "apartment", "house", "house"]
    others = source.further(4, {scene.identity for scene in first})
    assert not {scene.identity for scene in first} & {scene.identity for scene in others}


@pytest.mark.parametrize(("settings", "message"), [({"train": -1}, r"scenes\.train"), ({"houses": 1.5}, "houses")])
def test_mistakes_are_one_sentence(settings, message):
    with pytest.raises(DeuxError, match=message) as error:
        Interiors(**settings)
    assert "\n" not in str(error.value)
