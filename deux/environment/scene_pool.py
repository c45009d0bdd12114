"""Cache of the scenes that one process's environments have loaded, shared by all robots in them."""

from collections import OrderedDict

from deux.contracts import SceneReference, Simulator
from deux.simulator.simulation import Simulation


class ScenePool:
    """Makes simulators, loading each scene once; simulators of one scene share what is loaded.

    Args:
        simulation: makes the first simulator of each scene.
        colors: whether the robots see colours.
        most: scenes that are kept; the one that was used longest ago makes room.
    """

    def __init__(self, simulation: Simulation, colors: bool = True, most: int = 64) -> None:
        self.simulation = simulation
        self.colors = colors
        self._most = most
        self._loaded: OrderedDict[SceneReference, Simulator] = OrderedDict()

    def simulator(self, scene: SceneReference) -> Simulator:
        """A further robot in a scene; it stands nowhere before its `reset`.

        Raises:
            DeuxError: the scene cannot be loaded, or there is no floor in it.
        """
        if scene not in self._loaded:
            self._loaded[scene] = self.simulation.make(scene, self.colors)
            if len(self._loaded) > self._most:
                self._loaded.popitem(last=False)
        self._loaded.move_to_end(scene)
        return self._loaded[scene].another()
