"""Checks of the splits of a scene source: no scene twice, none in two splits, none missing."""

from collections import Counter
from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import Any

from deux.contracts import SceneReference, SceneSplits
from deux.errors import DeuxError

SPLITS = ("train", "validation", "test")


def make_splits(scenes: Mapping[str, Sequence[SceneReference]]) -> SceneSplits:
    """The splits of a source, by the names in `SPLITS`.

    Raises:
        DeuxError: a split lists a scene twice.
    """
    for split, references in scenes.items():
        name, count = Counter(scene.name for scene in references).most_common(1)[0] if references else ("", 0)
        if count > 1:
            raise DeuxError(f"scenes.{split} lists {name} {count} times: once is enough.")
    return SceneSplits(**{split: tuple(scenes.get(split, ())) for split in SPLITS})


def check_disjoint(splits: Mapping[str, Sequence[Any]], noun: str, advice: str = "") -> None:
    """Check that no item is in two splits.

    Args:
        splits: the items of each split, hashable.
        noun: how the message calls an item.
        advice: what else can be done about it; it ends the message.

    Raises:
        DeuxError: an item is in two splits.
    """
    for (first, some), (second, others) in combinations(splits.items(), 2):
        for item in sorted(set(some) & set(others))[:1]:
            raise DeuxError(f"{noun} {item} is in scenes.{first} and scenes.{second}: it must be in one only{advice}.")


def check_not_empty(splits: SceneSplits, needed: Sequence[str]) -> None:
    """Check that there are scenes in the splits that are needed.

    Raises:
        DeuxError: one of them names no scene.
    """
    for split in needed:
        if not getattr(splits, split):
            raise DeuxError(f"scenes.{split} names no scene: at least one is needed.")
