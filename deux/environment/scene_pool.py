"""Cache of loaded scenes, shared by the environments of a process."""

from collections import OrderedDict

from deux.contracts import SceneReference, Simulator
from deux.simulator.simulation import Simulation


class ScenePool:
    """Factory of simulators that share loaded scenes.

    Args:
        simulation: factory of the first simulator of each scene.
        colors: whether colours are rendered.
        most: maximum number of cached scenes; the least recently used one is removed.
    """

    def __init__(self, simulation: Simulation, colors: bool = True, most: int = 64) -> None:
        self.simulation = simulation
        self.colors = colors
        self._most = most
        self._loaded: OrderedDict[SceneReference, Simulator] = OrderedDict()

    def simulator(self, scene: SceneReference) -> Simulator:
        """Create a simulator of a scene; call its `reset` before anything else.

        Raises:
            DeuxError: the scene cannot be loaded or has no floor.
        """
        if scene not in self._loaded:
            self._loaded[scene] = self.simulation.make(scene, self.colors)
            if len(self._loaded) > self._most:
                self._loaded.popitem(last=False)
        self._loaded.move_to_end(scene)
        return self._loaded[scene].another()
