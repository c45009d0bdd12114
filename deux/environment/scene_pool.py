"""The scenes of one process's environments: each is loaded once, however many robots explore it."""

import copy
from collections import OrderedDict
from dataclasses import replace

from deux.contracts import Robot
from deux.geometry.camera import Camera
from deux.scenes.mesh import Material
from deux.scenes.scene import Scene
from deux.scenes.sources import SceneReference
from deux.simulator.mesh_simulator import MeshSimulator


class ScenePool:
    """Makes simulators; what they have in common, geometry and free floor, is shared.

    Args:
        camera: the robots' camera.
        robot: their body and motion.
        textured: whether the robots see colours; a flat without its textures takes a tenth of the memory.
        most: scenes that are kept; the one that was used longest ago makes room.
        renderer: "embree" or "pyrender".
    """

    def __init__(
        self, camera: Camera, robot: Robot, textured: bool = True, most: int = 64, renderer: str = "embree"
    ) -> None:
        self.camera = camera
        self.robot = robot
        self.textured = textured
        self._most = most
        self._renderer = renderer
        self._loaded: OrderedDict[SceneReference, MeshSimulator] = OrderedDict()

    def simulator(self, reference: SceneReference) -> MeshSimulator:
        """A simulator of its own, which shares with others of the same scene what none of them changes.

        Raises:
            DeuxError: the scene cannot be read, or there is no floor in it.
        """
        if reference not in self._loaded:
            scene = reference.load()
            scene = scene if self.textured else _untextured(scene)
            simulator = MeshSimulator(scene, self.camera, self.robot, self._renderer)
            simulator.prepare()
            self._loaded[reference] = simulator
            if len(self._loaded) > self._most:
                self._loaded.popitem(last=False)
        self._loaded.move_to_end(reference)
        # The parts that are made on first use are attributes of the simulator: its copy has them too.
        return copy.copy(self._loaded[reference])


def _untextured(scene: Scene) -> Scene:
    materials = tuple(Material(material.name) for material in scene.mesh.materials)
    return replace(scene, mesh=replace(scene.mesh, materials=materials))
