"""The scene source `apartments`: generated flats by seed, disjoint between the splits."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

from deux.contracts import Scene, SceneReference, SceneSource, SceneSplits
from deux.errors import DeuxError
from deux.scenes.splits import SPLITS, check_disjoint, make_splits
from deux_plugins.scenes.apartments.generator import APARTMENT_VERSION, apartment

FIRST_SEEDS = dict(zip(SPLITS, (0, 100_000, 200_000), strict=True))
"""The first seed of each split where a number of flats is asked for."""

FIRST_FURTHER_SEED = 300_000
"""The first seed of the flats that belong to no split."""


@dataclass(frozen=True)
class ApartmentReference(SceneReference):
    """A generated flat.

    Args:
        name: the scene's name.
        seed: seed of the generator.
    """

    seed: int

    @property
    def identity(self) -> str:
        """The generator's version and the seed."""
        return f"apartment:{APARTMENT_VERSION}:{self.seed}"

    def load(self) -> Scene:
        """Generate the flat."""
        return replace(apartment(self.seed), name=self.name)


class Apartments(SceneSource):
    """Furnished flats of 35 to 90 square metres, several rooms each, labelled; no download and no licence.

    Args:
        train: number of flats that are explored, or a list of their seeds.
        validation: number of flats that choose between models, or a list of their seeds.
        test: number of flats that are kept for the final numbers, or a list of their seeds.
    """

    def __init__(self, train: int | list[int] = 4, validation: int | list[int] = 1, test: int | list[int] = 2) -> None:
        self._seeds = {
            split: _seeds(split, asked) for split, asked in zip(SPLITS, (train, validation, test), strict=True)
        }
        check_disjoint(self._seeds, "seed")

    def splits(self) -> SceneSplits:
        """The flats of each split."""
        return make_splits({split: [reference(seed) for seed in seeds] for split, seeds in self._seeds.items()})

    def further(self, count: int, without: Collection[str]) -> tuple[SceneReference, ...]:
        """Flats of seeds from `FIRST_FURTHER_SEED` on."""
        seeds = range(FIRST_FURTHER_SEED, FIRST_FURTHER_SEED + count + len(without))
        others = [scene for seed in seeds if (scene := reference(seed)).identity not in without]
        return tuple(others[:count])


def reference(seed: int) -> ApartmentReference:
    """The locator of the flat of a seed."""
    return ApartmentReference(f"apartment_{seed:06d}", seed)


def _seeds(split: str, asked: int | Sequence[int]) -> tuple[int, ...]:
    if isinstance(asked, int):
        asked = range(FIRST_SEEDS[split], FIRST_SEEDS[split] + asked) if asked >= 0 else (asked,)
    if any(seed < 0 for seed in asked):
        raise DeuxError(f"scenes.{split} is {list(asked)}, but it must be a number of flats or a list of seeds >= 0.")
    return tuple(asked)
