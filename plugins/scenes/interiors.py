"""The scene source `interiors`: generated flats and houses together."""

from collections.abc import Collection

from deux.contracts import SceneReference, SceneSource, SceneSplits
from deux.errors import check_range
from deux_plugins.scenes.apartments import Apartments
from deux_plugins.scenes.houses import Houses
from deux_plugins.scenes.parts.seeded_scenes import MOST_SCENES


class Interiors(SceneSource):
    """Generated flats and houses together, to train models for both; no download needed.

    A fraction of each split are houses and the others flats. They are the scenes of the sources `apartments` and
    `houses` with the same numbers and the same draw.

    Args:
        train: number of scenes to explore.
        validation: number of scenes for model selection.
        test: number of scenes for the final evaluation.
        houses: fraction of houses among the scenes, from 0 to 1.
        draw: index of the draw, see `apartments`; None is draw 0.

    Raises:
        DeuxError: a number is negative, or the fraction is not between 0 and 1.
    """

    def __init__(
        self, train: int = 5, validation: int = 2, test: int = 5, houses: float = 0.4, draw: int | None = None
    ) -> None:
        for name, count in (("train", train), ("validation", validation), ("test", test)):
            check_range(f"scenes.{name}", count, 0, MOST_SCENES)
        check_range("scenes.houses", houses, 0, 1)
        self._fraction = houses
        of_houses = [round(houses * count) for count in (train, validation, test)]
        of_flats = [count - built for count, built in zip((train, validation, test), of_houses, strict=True)]
        self._houses = Houses(*of_houses, draw=draw)
        self._flats = Apartments(*of_flats, draw=draw)

    def splits(self) -> SceneSplits:
        """The scenes of each split, flats first."""
        flats, houses = self._flats.splits(), self._houses.splits()
        return SceneSplits(
            (*flats.train, *houses.train),
            (*flats.validation, *houses.validation),
            (*flats.test, *houses.test),
        )

    def further(self, count: int, without: Collection[str]) -> tuple[SceneReference, ...]:
        """Scenes that are in no split of any draw, with the same fraction of houses."""
        houses = round(self._fraction * count)
        return (*self._flats.further(count - houses, without), *self._houses.further(houses, without))
