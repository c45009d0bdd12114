"""Checks of the splits of a scene source: no scene twice, none in two splits, none missing."""

import logging
from collections import Counter
from collections.abc import Callable, Hashable, Mapping, Sequence
from itertools import combinations
from typing import Any, TypeVar

from deux.broken_contracts import broken_contract
from deux.contracts import SceneReference, SceneSource, SceneSplits
from deux.errors import DeuxError, kind_of

log = logging.getLogger(__name__)

SPLITS = ("train", "validation", "test")

T = TypeVar("T")


def _itself(item: Hashable) -> Hashable:
    return item


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


def splits_of(source: SceneSource) -> SceneSplits:
    """The scenes that a source's options ask for, as its `splits` gives them.

    Raises:
        DeuxError: it gives something else than tuples of references to scenes.
    """
    found: object = source.splits()
    if not isinstance(found, SceneSplits):
        raise broken_contract(source, kind_of(found), "a deux.contracts.SceneSplits", "splits")
    for split in SPLITS:
        scenes: object = getattr(found, split)
        odd = [kind_of(scenes)]
        if isinstance(scenes, tuple):
            odd = [f"{kind_of(one)} in a tuple" for one in scenes if not isinstance(one, SceneReference)]
        if odd:
            wanted = "a tuple of deux.contracts.SceneReference"
            raise broken_contract(source, f"{odd[0]} as {split}", wanted, "splits")
    return found


def identity_of(scene: SceneReference) -> str:
    """The identity of a scene, which is part of datasets' names.

    Raises:
        DeuxError: it is no text.
    """
    found: object = scene.identity
    if isinstance(found, str):
        return found
    called = f"the scene {scene.name} ({type(scene).__name__} of {type(scene).__module__})"
    raise broken_contract(called, kind_of(found), "text that says what made the scene", "identity")


def check_disjoint(
    splits: Mapping[str, Sequence[Any]],
    noun: str,
    advice: str = "",
    content: Callable[[Any], Hashable] = _itself,
) -> None:
    """Check that no item is in two splits, under one name or two.

    Args:
        splits: the items of each split, hashable.
        noun: how the message calls an item.
        advice: what else can be done about it; it ends the message.
        content: items of which it is equal are the same, such as copies of a file and links to it.

    Raises:
        DeuxError: an item is in two splits.
    """
    for (first, some), (second, others) in combinations(splits.items(), 2):
        known = {content(item): item for item in some}
        for other in others:
            item = known.get(content(other))
            if item == other:
                raise DeuxError(
                    f"{noun} {item} is in scenes.{first} and scenes.{second}: it must be in one only{advice}."
                )
            if item is not None:
                raise DeuxError(
                    f"{noun} {item} is in scenes.{first} and, as {other}, in scenes.{second}: it must be in one "
                    f"only{advice}."
                )


def check_apart(splits: SceneSplits) -> None:
    """Check that no scene is in two splits, under one name or two; parts of a scene that are apart are two scenes.

    Scenes in files are told apart by the files' places: their identity takes as long as reading them.

    Raises:
        DeuxError: a scene is in two splits.
    """
    scenes = {split: {_content(scene): scene.name for scene in getattr(splits, split)} for split in SPLITS}
    for (first, some), (second, others) in combinations(scenes.items(), 2):
        if shared := next((content for content in some if content in others), None):
            name, other = some[shared], others[shared]
            also = "" if other == name else f", as {other},"
            raise DeuxError(
                f"the scene {name} is in scenes.{first} and{also} in scenes.{second}: it must be in one only."
            )


def _content(scene: SceneReference) -> Hashable:
    return (identity_of(scene) if scene.file is None else scene.file.resolve(), scene.area)


def each_once(
    splits: Mapping[str, Sequence[T]], noun: str, content: Callable[[T], Hashable]
) -> dict[str, tuple[T, ...]]:
    """The splits without items that are in one of them a second time under another name, each of which is said.

    Args:
        splits: the items of each split.
        noun: how the message calls an item.
        content: as of `check_disjoint`.
    """
    kept: dict[str, tuple[T, ...]] = {}
    for split, items in splits.items():
        first: dict[Hashable, T] = {}
        for item in items:
            if first.setdefault(content(item), item) != item:
                log.warning(
                    "%s %s of scenes.%s is the same as %s: it is taken once.", noun, item, split, first[content(item)]
                )
        kept[split] = tuple(item for item in items if first[content(item)] == item)
    return kept


def check_not_empty(splits: SceneSplits, needed: Sequence[str]) -> None:
    """Check that there are scenes in the splits that are needed.

    Raises:
        DeuxError: one of them names no scene.
    """
    for split in needed:
        if not getattr(splits, split):
            raise DeuxError(f"scenes.{split} names no scene: at least one is needed.")
