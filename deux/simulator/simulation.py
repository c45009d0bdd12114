"""The factory of simulators with a given camera and robot."""

from dataclasses import asdict, dataclass
from typing import Any

from deux.contracts import Robot, SceneReference, Simulator
from deux.geometry.camera import Camera
from deux.registry import PluginChoice


@dataclass(frozen=True)
class Simulation:
    """Makes simulators of scenes; it can be sent to other processes.

    Args:
        camera: the robots' camera.
        robot: the robots' body and motion.
        simulator: the simulator plugin with its options.
    """

    camera: Camera
    robot: Robot
    simulator: PluginChoice

    def make(self, scene: SceneReference, colors: bool = True) -> Simulator:
        """Make the simulator of a scene, which is loaded.

        Raises:
            DeuxError: the scene cannot be loaded.
        """
        made: Simulator = self.simulator.create(scene, self.camera, self.robot, colors)
        return made

    def description(self) -> dict[str, Any]:
        """Everything that frames depend on besides scene and pose, as JSON values."""
        return {
            "camera": asdict(self.camera),
            "robot": asdict(self.robot),
            "simulator": self.simulator.description,
        }
