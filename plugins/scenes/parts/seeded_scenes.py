"""Sources of generated scenes: the same seeds for each split, whatever is generated."""

from abc import abstractmethod
from collections.abc import Collection, Sequence

from deux.contracts import SceneReference, SceneSource, SceneSplits
from deux.errors import DeuxError, check_range
from deux.scenes.splits import SPLITS, check_disjoint, make_splits

FIRST_SEEDS = dict(zip(SPLITS, (0, 100_000, 200_000), strict=True))
"""The first seed of each split where a number of scenes is asked for."""

MOST_SCENES = 100_000
"""Scenes that a split of one draw has room for."""

FIRST_FURTHER_SEED = 300_000
"""The first seed of the scenes that belong to no split of any draw."""

SEEDS_OF_A_DRAW = 1_000_000
"""Distance between the seeds of one draw and of the next: the further scenes lie below it, in the first."""


class SeededScenes(SceneSource):
    """Scenes by seed, disjoint between the splits.

    Args:
        train: number of scenes that are explored, or a list of their seeds.
        validation: number of scenes that choose between models, or a list of their seeds.
        test: number of scenes that are kept for the final numbers, or a list of their seeds.
        draw: number of the draw, from 0 upwards: no two draws share a scene where numbers of scenes are asked for.
            None takes the scenes of draw 0.
    """

    noun: str
    """What the messages call a number of these scenes, such as "flats"."""

    def __init__(
        self, train: int | list[int], validation: int | list[int], test: int | list[int], draw: int | None
    ) -> None:
        check_range("scenes.draw", draw or 0, 0)
        self._first_seed = (draw or 0) * SEEDS_OF_A_DRAW
        self._seeds = {
            split: self._split_seeds(split, asked)
            for split, asked in zip(SPLITS, (train, validation, test), strict=True)
        }
        check_disjoint(self._seeds, "seed")

    @abstractmethod
    def reference(self, seed: int) -> SceneReference:
        """The locator of the scene of a seed."""

    def splits(self) -> SceneSplits:
        """The scenes of each split."""
        return make_splits({split: [self.reference(seed) for seed in seeds] for split, seeds in self._seeds.items()})

    def further(self, count: int, without: Collection[str]) -> tuple[SceneReference, ...]:
        """Scenes of seeds from `FIRST_FURTHER_SEED` on."""
        seeds = range(FIRST_FURTHER_SEED, FIRST_FURTHER_SEED + count + len(without))
        others = [scene for seed in seeds if (scene := self.reference(seed)).identity not in without]
        return tuple(others[:count])

    def _split_seeds(self, split: str, asked: int | Sequence[int]) -> tuple[int, ...]:
        if isinstance(asked, int):
            if asked > MOST_SCENES:
                raise DeuxError(f"scenes.{split} is {asked}, but a draw has no more than {MOST_SCENES} {self.noun}.")
            first = self._first_seed + FIRST_SEEDS[split]
            asked = range(first, first + asked) if asked >= 0 else (asked,)
        if any(seed < 0 for seed in asked):
            raise DeuxError(
                f"scenes.{split} is {list(asked)}, but it must be a number of {self.noun} or a list of seeds >= 0."
            )
        return tuple(asked)
