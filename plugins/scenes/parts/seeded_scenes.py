"""The base class of sources of generated scenes, which assigns seeds to splits."""

from abc import abstractmethod
from collections.abc import Collection, Sequence

from deux.contracts import SceneReference, SceneSource, SceneSplits
from deux.errors import DeuxError, check_range
from deux.scenes.splits import SPLITS, check_disjoint, make_splits

FIRST_SEEDS = dict(zip(SPLITS, (0, 100_000, 200_000), strict=True))
"""The first seed of each split, if a number of scenes is requested."""

MOST_SCENES = 100_000
"""Greatest number of scenes in a split of one draw."""

FIRST_FURTHER_SEED = 300_000
"""The first seed of the scenes that are in no split of any draw."""

SEEDS_OF_A_DRAW = 1_000_000
"""Distance between the seeds of consecutive draws; the further scenes are between the first and the second draw."""


class SeededScenes(SceneSource):
    """Generated scenes, with disjoint seeds for the splits.

    Args:
        train: number of scenes to explore, or a list of their seeds.
        validation: number of scenes for model selection, or a list of their seeds.
        test: number of scenes for the final evaluation, or a list of their seeds.
        draw: index of the draw, from 0; if numbers of scenes are given, no two draws have a scene in common. None is
            draw 0.
    """

    noun: str
    """The plural noun for the scenes in messages, such as "flats"."""

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
        """The reference to the scene of a seed."""

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
                raise DeuxError(f"scenes.{split} is {asked}: it must be at most {MOST_SCENES} {self.noun}.")
            first = self._first_seed + FIRST_SEEDS[split]
            asked = range(first, first + asked) if asked >= 0 else (asked,)
        if any(seed < 0 for seed in asked):
            raise DeuxError(
                f"scenes.{split} is {list(asked)}: it must be a number of {self.noun} or a list of seeds >= 0."
            )
        return tuple(asked)
