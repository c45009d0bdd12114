"""The scene source `houses`: generated houses by seed, disjoint between the splits."""

from dataclasses import dataclass, replace

from deux.contracts import Scene, SceneReference
from deux.errors import DeuxError
from deux_plugins.scenes.houses.generator import LEAST_AREA, MOST_AREA, house, house_identity
from deux_plugins.scenes.parts.seeded_scenes import SeededScenes

NARROWEST = 1.2
"""Least ratio of the greatest to the least area: sizes in a narrower range are met too rarely."""


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
    """Furnished houses of 150 to 500 square metres on one floor, 8 to 25 rooms each, labelled; nothing to download.

    Args:
        train: number of houses that are explored, or a list of their seeds.
        validation: number of houses that choose between models, or a list of their seeds.
        test: number of houses that are kept for the final numbers, or a list of their seeds.
        least_area: least floor area of a house, square metres, 150 or more.
        most_area: greatest floor area, 500 or less and 1.2 times the least one or more.
        draw: number of the draw: each has other houses. The configuration sets the seed here, so that a seed changes
            the houses as well; None takes the same ones for every seed, those of draw 0. Lists of seeds
            stay as they are.

    Raises:
        DeuxError: the range of areas is not one that houses can have.
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
                f"scenes.least_area is {least_area} and scenes.most_area {most_area}, but houses have {LEAST_AREA} to "
                f"{MOST_AREA} square metres, and the greatest area must be {NARROWEST} times the least or more."
            )
        super().__init__(train, validation, test, draw)
        self._areas = least_area, most_area

    def reference(self, seed: int) -> HouseReference:
        """The locator of the house of a seed."""
        return HouseReference(f"house_{seed:06d}", seed, *self._areas)
