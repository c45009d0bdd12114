"""The style of a scene: the materials of its furniture."""

from deux_plugins.scenes.parts.draws import Draws
from deux_plugins.scenes.parts.surfaces import Surface, Surfaces


class Style:
    """Chooses materials such that most of the furniture matches.

    Args:
        surfaces: the surfaces of the scene.
        draws: the random numbers, also for the sizes of the furniture.
    """

    def __init__(self, surfaces: Surfaces, draws: Draws) -> None:
        self.draws = draws
        self._surfaces = surfaces
        self._main_wood = surfaces.pick(draws, "wood")
        self._main_paint = surfaces.pick(draws, "paint", "wood")
        self._main_metal = surfaces.pick(draws, "metal")
        self.trim = surfaces.pick(draws, "paint", "wood")
        """The material of all door frames, window frames and skirting boards."""

    def wood(self) -> Surface:
        """Wood of furniture."""
        return self._main_wood if self.draws.chance(0.5) else self.pick("wood", "wood", "paint")

    def front(self) -> Surface:
        """Doors and drawers."""
        return self._main_paint if self.draws.chance(0.6) else self.pick("wood", "paint")

    def metal(self) -> Surface:
        """Legs, taps, appliances."""
        return self._main_metal

    def ceramic(self) -> Surface:
        """Basins, tubs, tiles of worktops."""
        return self.pick("enamel", "marble")

    def stone(self) -> Surface:
        """Worktops."""
        return self.pick("marble", "wood")

    def cloth(self) -> Surface:
        """Upholstery and curtains."""
        return self.pick("weave", "weave", "plaid", "linen")

    def upholstery(self) -> Surface:
        """The cover of a sofa or an armchair."""
        return self.pick("weave", "plaid", "leather")

    def linen(self) -> Surface:
        """Bed linen."""
        return self.pick("linen", "plaid")

    def picture(self) -> Surface:
        """A painting."""
        return self.pick("landscape", "abstract", "still life", "city")

    def pick(self, *kinds: str) -> Surface:
        """A random surface of one of these kinds of material."""
        return self._surfaces.pick(self.draws, *kinds)
