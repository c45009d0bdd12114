"""The scene source `houses`: generated houses, with disjoint seeds for the splits."""

from dataclasses import dataclass, replace

from deux.contracts import Scene, SceneReference
from deux.errors import DeuxError
from deux_plugins.scenes.houses.generator import LEAST_AREA, MOST_AREA, house, house_identity
from deux_plugins.scenes.parts.seeded_scenes import SeededScenes

NARROWEST = 1.2
"""Least ratio of the greatest to the least area; in a narrower range plans of valid size are too rare."""


@dataclass(frozen=True)
class HouseReference(SceneReference):
    """A generated house.

    Args:
        name: the scene's name.
        seed: seed of the generator.
        least_area: least floor area, square metres.
        most_area: greatest floor area.
    """

    seed: int
    least_area: int
    most_area: int

    @property
    def identity(self) -> str:
        """The generator's version, the range of areas and the seed."""
        return house_identity(self.seed, self.least_area, self.most_area)

    def load(self) -> Scene:
        """Generate the house."""
        return replace(house(self.seed, self.least_area, self.most_area), name=self.name)


class Houses(SeededScenes):
    """Generated houses of 150 to 500 square metres with one floor and 8 to 25 furnished, labelled rooms; no download.

    Args:
        train: number of houses to explore, or a list of their seeds.
        validation: number of houses for model selection, or a list of their seeds.
        test: number of houses for the final evaluation, or a list of their seeds.
        least_area: least floor area of a house, square metres, at least 150.
        most_area: greatest floor area, at most 500 and at least 1.2 times the least area.
        draw: index of the draw, each of which has different houses; the configuration sets it to the seed of the run.
            None is draw 0. Lists of seeds do not depend on it.

    Raises:
        DeuxError: the range of areas is invalid.
    """

    noun = "houses"

    def __init__(
        self,
        train: int | list[int] = 6,
        validation: int | list[int] = 2,
        test: int | list[int] = 16,
        least_area: int = LEAST_AREA,
        most_area: int = MOST_AREA,
        draw: int | None = None,
    ) -> None:
        if not LEAST_AREA <= least_area <= most_area <= MOST_AREA or NARROWEST * least_area > most_area:
            raise DeuxError(
                f"scenes.least_area is {least_area} and scenes.most_area {most_area}: both must be from {LEAST_AREA} "
                f"to {MOST_AREA} square metres, and the greatest area at least {NARROWEST} times the least."
            )
        super().__init__(train, validation, test, draw)
        self._areas = least_area, most_area

    def reference(self, seed: int) -> HouseReference:
        """The reference to the house of a seed."""
        return HouseReference(f"house_{seed:06d}", seed, *self._areas)
