import pytest

from deux.contracts import SceneSource
from deux.errors import DeuxError
from deux.options import construct
from deux.testing.scenes import SceneSourceSuite
from deux_plugins.scenes.apartments import ApartmentReference, Apartments


class TestApartments(SceneSourceSuite):
    def make_source(self) -> SceneSource:
        return Apartments(train=2, validation=1, test=1)


def seeds(scenes):
    return [scene.seed for scene in scenes]


def test_asking_for_more_keeps_the_first():
    few, many = Apartments(3, 1, 2).splits(), Apartments(50, 9, 9).splits()
    assert (len(few.train), len(few.validation), len(few.test)) == (3, 1, 2)
    assert many.train[:3] == few.train
    assert many.test[:2] == few.test


def test_seeds_can_be_listed():
    splits = Apartments(train=[7, 3], validation=0, test=[11]).splits()
    assert (seeds(splits.train), splits.validation, seeds(splits.test)) == ([7, 3], (), [11])


def test_a_flat_loads_under_its_name_and_identity():
    (reference,) = Apartments(train=[5]).splits().train
    scene = reference.load()
    assert (scene.name, scene.identity) == (reference.name, reference.identity)
    assert reference.identity != ApartmentReference(reference.name, 6).identity


def test_further_flats_are_none_of_the_splits():
    source = Apartments(train=[0, 300_000], validation=[300_002], test=1)
    splits = source.splits()
    used = {scene.identity for scene in (*splits.train, *splits.validation, *splits.test)}
    assert seeds(source.further(3, used)) == [300_001, 300_003, 300_004]


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"trian": 1}, "did you mean train"),
        ({"train": [1, 2], "test": [2]}, "seed 2 is in scenes.train and scenes.test"),
        ({"train": 200_001}, "scenes.train is 200001: it must be at most 100000 flats"),
        ({"train": [1, 1]}, "list it once"),
        ({"train": -2}, r"scenes\.train is"),
        ({"train": [-2]}, r"scenes\.train is"),
        ({"train": True}, r"scenes\.train must be a whole number or a list"),
        ({"train": "many"}, r"scenes\.train must be"),
        ({"train": [0.5]}, r"scenes\.train must be"),
    ],
)
def test_mistakes_are_one_sentence(settings, message):
    with pytest.raises(DeuxError, match=message) as error:
        construct(Apartments, settings, "scenes").splits()
    assert "\n" not in str(error.value)


def test_no_scene_is_in_two_draws_or_among_the_further_ones():
    draws = [Apartments(20, 5, 20, draw=draw).splits() for draw in range(4)]
    every = [seed for one in draws for split in (one.train, one.validation, one.test) for seed in seeds(split)]
    assert len(set(every)) == len(every)
    assert set(seeds(Apartments().further(700, ()))).isdisjoint(every)


def test_draw_0_has_the_scenes_of_all_seeds_without_draws():
    assert Apartments(3, 1, 2, draw=0).splits() == Apartments(3, 1, 2).splits()
    assert seeds(Apartments(2, 1, 1, draw=2).splits().test) == [2_200_000]
    assert seeds(Apartments([7], 0, [9], draw=2).splits().test) == [9]
    with pytest.raises(DeuxError, match=r"scenes\.draw"):
        Apartments(draw=-1)
