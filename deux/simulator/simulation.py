"""The factory of simulators: which one is made, with which camera and robot."""

from dataclasses import asdict, dataclass
from typing import Any

from deux.contracts import Robot, SceneReference, Simulator
from deux.geometry.camera import Camera
from deux.registry import PluginChoice


@dataclass(frozen=True)
class Simulation:
    """Makes the simulators of scenes; it travels to other processes.

    Args:
        camera: the robots' camera.
        robot: their body and motion.
        simulator: the simulator with its options.
    """

    camera: Camera
    robot: Robot
    simulator: PluginChoice

    def make(self, scene: SceneReference, colors: bool = True) -> Simulator:
        """A robot in a scene, which is loaded.

        Raises:
            DeuxError: the scene cannot be loaded.
        """
        made: Simulator = self.simulator.create(scene, self.camera, self.robot, colors)
        return made

    def description(self) -> dict[str, Any]:
        """All that frames depend on besides scene and pose, as JSON values."""
        return {
            "camera": asdict(self.camera),
            "robot": asdict(self.robot),
            "simulator": self.simulator.description,
        }
