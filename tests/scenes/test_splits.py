from dataclasses import dataclass
from pathlib import Path

import pytest

from deux.contracts import SceneArea, SceneReference, SceneSource, SceneSplits
from deux.errors import DeuxError
from deux.scenes.splits import check_apart, check_disjoint, check_not_empty, each_once, make_splits, splits_of


@dataclass(frozen=True)
class Named(SceneReference):
    @property
    def identity(self) -> str:
        return self.name


def test_splits_keep_the_order_and_may_be_empty():
    splits = make_splits({"train": [Named("b"), Named("a")], "test": [Named("c")]})
    assert splits == SceneSplits((Named("b"), Named("a")), (), (Named("c"),))


def test_a_scene_is_listed_once():
    with pytest.raises(DeuxError, match=r"scenes\.train lists a 2 times: list it once"):
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


@dataclass(frozen=True)
class Seeded(SceneReference):
    seed: int = 0

    @property
    def identity(self) -> str:
        return f"seed-{self.seed}"


@dataclass(frozen=True)
class Filed(SceneReference):
    path: Path

    @property
    def identity(self) -> str:
        raise AssertionError("a file was read")

    @property
    def file(self) -> Path:
        return self.path


def test_a_scene_in_two_splits_is_named_with_both():
    check_apart(SceneSplits((Seeded("a", 1), Seeded("b", 2)), (), (Seeded("c", 3),)))
    with pytest.raises(DeuxError, match=r"^the scene b is in scenes\.train and in scenes\.test: it must be in one"):
        check_apart(SceneSplits((Seeded("a", 1), Seeded("b", 2)), (), (Seeded("b", 2),)))
    with pytest.raises(DeuxError, match=r"^the scene c is in scenes\.validation and, as d, in scenes\.test: it must"):
        check_apart(SceneSplits((), (Seeded("c", 3),), (Seeded("d", 3),)))


def test_scenes_in_files_are_told_apart_by_their_places_and_parts(tmp_path):
    near, far = SceneArea(region=(0.0, 0.0, 4.0, 4.0)), SceneArea(region=(4.0, 0.0, 8.0, 4.0))
    one, other = tmp_path / "one.glb", tmp_path / "other.glb"
    check_apart(SceneSplits((Filed("a", one), Filed("b", other, area=near)), (), (Filed("c", other, area=far),)))
    link = tmp_path / "link.glb"
    link.symlink_to(one)
    with pytest.raises(DeuxError, match=r"^the scene a is in scenes\.train and, as c, in scenes\.test"):
        check_apart(SceneSplits((Filed("a", one),), (), (Filed("c", link),)))


def test_two_names_of_one_content_in_one_split_are_taken_once(caplog):
    kept = each_once({"train": ["A", "b", "a", "B"], "test": ["a"]}, "seed", str.lower)
    assert kept == {"train": ("A", "b"), "test": ("a",)}
    assert "seed a of scenes.train is the same as A: it is used once." in caplog.text
    assert caplog.text.count("used once") == 2


def test_needed_splits_must_hold_a_scene():
    splits = make_splits({"train": [Named("a")]})
    check_not_empty(splits, ["train"])
    with pytest.raises(DeuxError, match=r"scenes\.test names no scene"):
        check_not_empty(splits, ["train", "test"])


@pytest.mark.parametrize(
    ("splits", "told"),
    [
        (None, r"None: it must be a deux\.contracts\.SceneSplits\."),
        ({"train": ()}, r"a value of the type dict: it must be a deux\.contracts\.SceneSplits\."),
        (SceneSplits([Named("a")], (), ()), "a value of the type list as train: it must be a tuple of deux"),  # type: ignore[arg-type]
        (SceneSplits((), None, ()), "None as validation: it must be a tuple of deux"),  # type: ignore[arg-type]
        (
            SceneSplits((Named("set/a"),), (), ()),
            "a scene called 'set/a' as train: it must be a name that a folder can",
        ),
        (SceneSplits((), (), (Named(""),)), "a scene called '' as test: it must be a name"),
        (SceneSplits((), (), ("a",)), "a value of the type str in a tuple as test: it must be a tuple of deux"),  # type: ignore[arg-type]
    ],
)
def test_the_source_is_named_for_what_are_no_splits(splits, told):
    class Source(SceneSource):
        def splits(self):
            return splits

    with pytest.raises(DeuxError, match=f"^the `splits` of the source of scenes Source gives {told}"):
        splits_of(Source())
