"""The scene source `apartments`: generated flats by seed, disjoint between the splits."""

from dataclasses import dataclass, replace

from deux.contracts import Scene, SceneReference
from deux_plugins.scenes.apartments.generator import APARTMENT_VERSION, apartment
from deux_plugins.scenes.parts.seeded_scenes import SeededScenes


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


class Apartments(SeededScenes):
    """Furnished flats of 35 to 90 square metres, several rooms each, labelled; no download and no licence.

    Args:
        train: number of flats that are explored, or a list of their seeds.
        validation: number of flats that choose between models, or a list of their seeds.
        test: number of flats that are kept for the final numbers, or a list of their seeds.
        draw: number of the draw: each has other flats. The configuration sets the seed here, so that a seed changes the
            flats as well; None takes the same ones for every seed, those of draw 0. Lists of seeds stay as they are.
    """

    noun = "flats"

    def __init__(
        self,
        train: int | list[int] = 4,
        validation: int | list[int] = 1,
        test: int | list[int] = 2,
        draw: int | None = None,
    ) -> None:
        super().__init__(train, validation, test, draw)

    def reference(self, seed: int) -> ApartmentReference:
        """The locator of the flat of a seed."""
        return reference(seed)


def reference(seed: int) -> ApartmentReference:
    """The locator of the flat of a seed."""
    return ApartmentReference(f"apartment_{seed:06d}", seed)
