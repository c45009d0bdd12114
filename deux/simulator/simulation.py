"""The factory of simulators: which one is made, with which camera and robot."""

import traceback
from dataclasses import asdict, dataclass
from typing import Any

from deux.contracts import Robot, SceneReference, Simulator
from deux.errors import DeuxError
from deux.geometry.camera import Camera
from deux.registry import PluginChoice, registry


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
            DeuxError: the scene cannot be loaded, or the simulator, which is of another package, fails on it.
        """
        try:
            made: Simulator = self.simulator.create(scene, self.camera, self.robot, colors)
        except (AttributeError, TypeError, ValueError, LookupError, AssertionError, NotImplementedError) as error:
            plugin, module = registry().find("simulators", self.simulator.name), type(scene).__module__
            if _package(plugin.target) == _package(module) or _passed(error, module):
                raise  # a mistake in the package that brings both, or in how the scene is loaded
            raise DeuxError(
                f"{plugin.called} cannot open the scene {scene.name}, a {type(scene).__name__} of {_package(module)} "
                f"({type(error).__name__}: {error}): choose one of the scenes that it is made for with scenes=, or "
                "another simulator with simulator=."
            ) from error
        return made

    def description(self) -> dict[str, Any]:
        """All that frames depend on besides scene and pose, as JSON values."""
        return {
            "camera": asdict(self.camera),
            "robot": asdict(self.robot),
            "simulator": self.simulator.description,
        }


def _package(name: str) -> str:
    """The top package of a module, or of what an entry point leads to."""
    return name.partition(":")[0].partition(".")[0]


def _passed(error: BaseException, module: str) -> bool:
    """Whether the package of a module was running when the error was raised."""
    frames = (frame for frame, _ in traceback.walk_tb(error.__traceback__))
    return any(_package(frame.f_globals.get("__name__") or "") == _package(module) for frame in frames)
