import pytest

from deux.contracts import SceneSource
from deux.errors import DeuxError
from deux.options import construct
from deux.testing.scenes import SceneSourceSuite
from deux_plugins.scenes.apartments import Apartments
from deux_plugins.scenes.houses import Houses


class TestHouses(SceneSourceSuite):
    def make_source(self) -> SceneSource:
        return Houses(train=1, validation=0, test=1, most_area=200)


def test_splits_have_the_seeds_of_flats():
    houses, flats = (kind(train=2, validation=1, test=[7]).splits() for kind in (Houses, Apartments))
    for split in ("train", "validation", "test"):
        seeds = [[scene.seed for scene in getattr(splits, split)] for splits in (houses, flats)]
        assert seeds[0] == seeds[1]
    assert not {s.identity for s in houses.train} & {s.identity for s in flats.train}


def test_the_range_of_areas_is_part_of_the_identity():
    small, large = (Houses(1, 0, 1, *areas).splits().train[0] for areas in ((150, 200), (400, 500)))
    assert small.identity != large.identity
    assert 150.0 <= small.load().floors[0].area <= 200.0


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"train": -2}, r"scenes\.train is .* number of houses"),
        ({"train": [1, 2], "test": [2]}, "seed 2 is in scenes.train and scenes.test"),
        ({"least_area": 90}, "least_area is 90 and .* 150 to 500"),
        ({"most_area": 600}, "most_area 600"),
        ({"least_area": 300, "most_area": 320}, r"1\.2 times"),
        ({"most_area": 300.5}, r"scenes\.most_area must be"),
    ],
)
def test_mistakes_are_one_sentence(settings, message):
    with pytest.raises(DeuxError, match=message) as error:
        construct(Houses, settings, "scenes").splits()
    assert "\n" not in str(error.value)
