from dataclasses import dataclass

import pytest

from deux.contracts import SceneReference, SceneSplits
from deux.errors import DeuxError
from deux.scenes.splits import check_disjoint, check_not_empty, each_once, make_splits


@dataclass(frozen=True)
class Named(SceneReference):
    @property
    def identity(self) -> str:
        return self.name


def test_splits_keep_the_order_and_may_be_empty():
    splits = make_splits({"train": [Named("b"), Named("a")], "test": [Named("c")]})
    assert splits == SceneSplits((Named("b"), Named("a")), (), (Named("c"),))


def test_a_scene_is_listed_once():
    with pytest.raises(DeuxError, match=r"scenes\.train lists a 2 times: once is enough"):
        make_splits({"train": [Named("a"), Named("b"), Named("a")]})


def test_what_is_in_two_splits_is_named_with_both_and_the_advice():
    check_disjoint({"train": [1, 2], "validation": [], "test": [3]}, "seed")
    with pytest.raises(DeuxError) as error:
        check_disjoint({"train": [1, 2], "validation": [3], "test": [2]}, "seed", ", or leave it")
    assert str(error.value) == "seed 2 is in scenes.train and scenes.test: it must be in one only, or leave it."


def test_two_names_of_one_content_in_two_splits_are_named_both():
    with pytest.raises(
        DeuxError, match=r"^seed A is in scenes\.train and, as a, in scenes\.test: it must be in one only"
    ):
        check_disjoint({"train": ["A", "b"], "validation": ["c"], "test": ["a"]}, "seed", content=str.lower)


def test_two_names_of_one_content_in_one_split_are_taken_once(caplog):
    kept = each_once({"train": ["A", "b", "a", "B"], "test": ["a"]}, "seed", str.lower)
    assert kept == {"train": ("A", "b"), "test": ("a",)}
    assert "seed a of scenes.train is the same as A: it is taken once." in caplog.text
    assert caplog.text.count("taken once") == 2


def test_needed_splits_must_hold_a_scene():
    splits = make_splits({"train": [Named("a")]})
    check_not_empty(splits, ["train"])
    with pytest.raises(DeuxError, match=r"scenes\.test names no scene"):
        check_not_empty(splits, ["train", "test"])
