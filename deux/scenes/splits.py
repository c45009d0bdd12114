"""Checks of the splits of a scene source: no duplicate scenes, no scene in two splits, no missing scenes."""

import logging
from collections import Counter
from collections.abc import Callable, Hashable, Mapping, Sequence
from itertools import combinations
from typing import Any, TypeVar

from deux.broken_contracts import broken_contract
from deux.contracts import Scene, SceneReference, SceneSource, SceneSplits
from deux.errors import DeuxError, kind_of, shown

log = logging.getLogger(__name__)

SPLITS = ("train", "validation", "test")

T = TypeVar("T")


def _itself(item: Hashable) -> Hashable:
    return item


def make_splits(scenes: Mapping[str, Sequence[SceneReference]]) -> SceneSplits:
    """Make the splits of a source from the scenes of each split, by its name.

    Raises:
        DeuxError: a split lists a scene twice.
    """
    for split, references in scenes.items():
        name, count = Counter(scene.name for scene in references).most_common(1)[0] if references else ("", 0)
        if count > 1:
            raise DeuxError(f"scenes.{split} lists {name} {count} times: list it once.")
    return SceneSplits(**{split: tuple(scenes.get(split, ())) for split in SPLITS})


def splits_of(source: SceneSource) -> SceneSplits:
    """Call `SceneSource.splits` and check its result.

    Raises:
        DeuxError: the result is not a `SceneSplits` of tuples of `SceneReference`, or a scene's name cannot be that of
            a folder, in which its frames are stored.
    """
    found: object = source.splits()
    if not isinstance(found, SceneSplits):
        raise broken_contract(source, kind_of(found), "a deux.contracts.SceneSplits", "splits")
    for split in SPLITS:
        scenes: Any = getattr(found, split)
        invalid = [kind_of(scenes)]
        if isinstance(scenes, tuple):
            invalid = [f"{kind_of(one)} in a tuple" for one in scenes if not isinstance(one, SceneReference)]
        if invalid:
            wanted = "a tuple of deux.contracts.SceneReference"
            raise broken_contract(source, f"{invalid[0]} as {split}", wanted, "splits")
        for name in (scene.name for scene in scenes):
            if not isinstance(name, str) or name in ("", ".", "..") or "/" in name:
                wanted = "a name that a folder can have, without /"
                raise broken_contract(source, f"a scene called {shown(name)} as {split}", wanted, "splits")
    return found


def identity_of(scene: SceneReference) -> str:
    """The identity of a scene, which is part of the names of datasets.

    Raises:
        DeuxError: it is not a string.
    """
    found: object = scene.identity
    if isinstance(found, str):
        return found
    raise broken_contract(described(scene), kind_of(found), "text that says what made the scene", "identity")


def described(scene: SceneReference | Scene) -> str:
    """A scene in a message, with the class of its reference, which tells the package of its source."""
    return f"the scene {scene.name} ({type(scene).__name__} of {type(scene).__module__})"


def check_disjoint(
    splits: Mapping[str, Sequence[Any]],
    noun: str,
    advice: str = "",
    content: Callable[[Any], Hashable] = _itself,
) -> None:
    """Check that no item is in two splits, under the same name or different names.

    Args:
        splits: the hashable items of each split.
        noun: the noun for an item in the message.
        advice: the end of the message, such as another remedy.
        content: a key that is equal for equal items, such as copies of a file and links to it.

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
    """Check that no scene is in two splits, under the same name or different names.

    Different areas of the same scene are different scenes. Scenes in files are compared by the paths of their files,
    because their identity takes as long as reading them.

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
    """Remove items that are in the same split under another name, with a warning for each.

    Args:
        splits: the items of each split.
        noun: the noun for an item in the message.
        content: see `check_disjoint`.
    """
    unique: dict[str, tuple[T, ...]] = {}
    for split, items in splits.items():
        first: dict[Hashable, T] = {}
        for item in items:
            if first.setdefault(content(item), item) != item:
                log.warning(
                    "%s %s of scenes.%s is the same as %s: it is used once.", noun, item, split, first[content(item)]
                )
        unique[split] = tuple(item for item in items if first[content(item)] == item)
    return unique


def check_not_empty(splits: SceneSplits, needed: Sequence[str]) -> None:
    """Check that the needed splits have scenes.

    Raises:
        DeuxError: a needed split is empty.
    """
    for split in needed:
        if not getattr(splits, split):
            raise DeuxError(f"scenes.{split} names no scene: at least one is needed.")
