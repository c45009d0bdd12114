"""The scene source `apartments`: generated flats, with disjoint seeds for the splits."""

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
    """Generated flats of 35 to 90 square metres with several furnished, labelled rooms; no download or licence needed.

    Args:
        train: number of flats to explore, or a list of their seeds.
        validation: number of flats for model selection, or a list of their seeds.
        test: number of flats for the final evaluation, or a list of their seeds.
        draw: index of the draw, each of which has different flats; the configuration sets it to the seed of the run.
            None is draw 0. Lists of seeds do not depend on it.
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
        """The reference to the flat of a seed."""
        return reference(seed)


def reference(seed: int) -> ApartmentReference:
    """The reference to the flat of a seed."""
    return ApartmentReference(f"apartment_{seed:06d}", seed)
