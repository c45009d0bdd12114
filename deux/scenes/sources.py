"""Where scenes come from: the settings of the configuration group `scenes`, made into references that load later."""

from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from pathlib import Path
from typing import TYPE_CHECKING, Any

from deux.errors import DeuxError, near_matches
from deux.scenes.scene import Scene

if TYPE_CHECKING:
    from deux.scenes.mesh_reader import Up

FIRST_SEEDS = {"train": 0, "validation": 100_000, "test": 200_000}
"""The first seed of each split's apartments where a number of them is asked for."""

FIRST_SYNTHETIC_SEED = 300_000
"""The first seed of `synthetic_scenes`."""


@dataclass(frozen=True)
class SceneReference(ABC):
    """A scene that is not loaded yet; cheap to keep, compare, hash and send to another process.

    Args:
        name: the scene's name, unique within its splits.
    """

    name: str

    @property
    @abstractmethod
    def identity(self) -> str:
        """The identity of the scene (see `Scene`), without loading it."""

    @abstractmethod
    def load(self) -> Scene:
        """Make or read the scene, anew at each call."""


@dataclass(frozen=True)
class ApartmentReference(SceneReference):
    """A generated apartment.

    Args:
        name: the scene's name.
        seed: seed of the generator.
    """

    seed: int

    @property
    def identity(self) -> str:
        """The generator's version and the seed."""
        from deux.scenes.apartments import APARTMENT_VERSION

        return f"apartment:{APARTMENT_VERSION}:{self.seed}"

    def load(self) -> Scene:
        """Generate the apartment."""
        from deux.scenes.apartments import apartment

        return replace(apartment(self.seed), name=self.name)


@dataclass(frozen=True)
class FileReference(SceneReference):
    """A scene in a file.

    Args:
        name: the scene's name.
        path: the file, absolute.
        up: the axis of the file that points up, "y" or "z".
    """

    path: Path
    up: "Up" = "y"

    @property
    def identity(self) -> str:
        """The hash of the file's content, wherever the file lies; read once in each process."""
        from deux.scenes.files import file_identity

        return file_identity(self.path, self.up)

    def load(self) -> Scene:
        """Read the file."""
        from deux.scenes.files import load_scene

        return replace(load_scene(self.path, self.up), name=self.name)


@dataclass(frozen=True)
class SceneSplits:
    """The scenes of one experiment: to explore, to choose by, and to test on.

    Args:
        train: scenes that are explored.
        validation: scenes that choose between models; may be none.
        test: scenes that are kept for the final numbers.
    """

    train: tuple[SceneReference, ...]
    validation: tuple[SceneReference, ...]
    test: tuple[SceneReference, ...]


def scene_splits(settings: Mapping[str, Any], needed: Sequence[str] = ("train", "test")) -> SceneSplits:
    """The scenes that the configuration group `scenes` asks for.

    Args:
        settings: `source` and that source's options.
            apartments: `train`, `validation`, `test`: each a number of apartments or a list of seeds.
            files: `train`, `validation`, `test`: each a path or a list of paths, relative to the working directory;
            `up`: "y" or "z"; `allow_overlap`: whether a file may serve in two splits.
        needed: the splits that must have a scene.

    Raises:
        DeuxError: an option is unknown or wrong, a file or a needed split is missing, or the splits overlap.
    """
    options = dict(settings)
    source = options.pop("source", None)
    if source not in _SOURCES:
        raise DeuxError(f"scenes.source is {source!r}, which is no source: {near_matches(str(source), _SOURCES)}")
    make, known = _SOURCES[source]
    for option in options:
        if option not in known:
            raise DeuxError(f"scenes.{option} is not an option of {source}: {near_matches(str(option), known)}")
    for split in needed:
        if not options.get(split):
            raise DeuxError(f"scenes.{split} names no scene: at least one is needed.")
    return make(options)


def synthetic_scenes(count: int, splits: SceneSplits) -> tuple[SceneReference, ...]:
    """Generated apartments that are none of the experiment's own scenes, whatever those are.

    They stand for the synthetic data, with ground truth, on which supervised models are trained before they meet the
    scenes of an experiment.

    Args:
        count: number of apartments.
        splits: the experiment's scenes.
    """
    own = {scene.identity for scene in (*splits.train, *splits.validation, *splits.test)}
    seeds = range(FIRST_SYNTHETIC_SEED, FIRST_SYNTHETIC_SEED + count + len(own))
    others = [reference for seed in seeds if (reference := _apartment(seed)).identity not in own]
    return tuple(others[:count])


def _apartment(seed: int) -> ApartmentReference:
    return ApartmentReference(f"apartment_{seed:06d}", seed)


def _apartments(options: Mapping[str, Any]) -> SceneSplits:
    seeds = {split: _seeds(split, options.get(split) or ()) for split in FIRST_SEEDS}
    _check_disjoint(seeds, "seed")
    return _splits({s: tuple(map(_apartment, seeds[s])) for s in seeds})


def _seeds(split: str, asked: object) -> tuple[int, ...]:
    if type(asked) is int:  # not a bool
        asked = range(FIRST_SEEDS[split], FIRST_SEEDS[split] + asked) if asked >= 0 else (asked,)
    if not isinstance(asked, Sequence) or not all(type(seed) is int and seed >= 0 for seed in asked):
        raise DeuxError(f"scenes.{split} is {asked!r}, but it must be a number of apartments or a list of seeds >= 0.")
    return tuple(asked)


def _files(options: Mapping[str, Any]) -> SceneSplits:
    up = options.get("up", "y")
    if up not in ("y", "z"):
        raise DeuxError(f"scenes.up is {up!r}, but it must be y or z, the axis of the files that points up.")
    paths = {split: _paths(split, options.get(split) or ()) for split in FIRST_SEEDS}
    if not options.get("allow_overlap", False):
        _check_disjoint(paths, "file", " (scenes.allow_overlap=true lets it)")
    names = _names({path for split in paths.values() for path in split})
    return _splits({s: tuple(FileReference(names[path], path, up) for path in paths[s]) for s in paths})


def _paths(split: str, asked: object) -> tuple[Path, ...]:
    from deux.scenes.files import check_scene_file

    if isinstance(asked, str | Path):
        asked = (asked,)
    if not isinstance(asked, Sequence) or not all(isinstance(path, str | Path) for path in asked):
        raise DeuxError(f"scenes.{split} is {asked!r}, but it must be a path or a list of paths.")
    return tuple(check_scene_file(path) for path in asked)


def _names(paths: set[Path]) -> dict[Path, str]:
    """A name for each file: its stem; its folder before it where two files share a stem, as in Replica's."""
    stems = Counter(path.stem for path in paths)
    names = {p: p.stem if stems[p.stem] == 1 else f"{p.parent.name}_{p.stem}" for p in paths}
    for name, count in Counter(names.values()).items():
        if count > 1:
            both = " and ".join(str(path) for path in sorted(names) if names[path] == name)
            raise DeuxError(f"the scene files {both} would both be called {name}: rename one or its folder.")
    return names


def _check_disjoint(splits: Mapping[str, tuple[Any, ...]], kind: str, hint: str = "") -> None:
    for (first, some), (second, others) in combinations(splits.items(), 2):
        for item in sorted(set(some) & set(others))[:1]:
            raise DeuxError(f"{kind} {item} is in scenes.{first} and scenes.{second}: it must be in one only{hint}.")


def _splits(references: Mapping[str, tuple[SceneReference, ...]]) -> SceneSplits:
    for split, scenes in references.items():
        name, count = Counter(scene.name for scene in scenes).most_common(1)[0] if scenes else ("", 0)
        if count > 1:
            raise DeuxError(f"scenes.{split} lists {name} {count} times: once is enough.")
    return SceneSplits(**references)


_SPLIT_OPTIONS = ("train", "validation", "test")
_SOURCES: dict[str, tuple[Callable[[Mapping[str, Any]], SceneSplits], tuple[str, ...]]] = {
    "apartments": (_apartments, _SPLIT_OPTIONS),
    "files": (_files, (*_SPLIT_OPTIONS, "up", "allow_overlap")),
}
