"""One open Habitat-Sim: a scene, its navmesh, and the sensors that look at it."""

from __future__ import annotations

import os
import re
import sys
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from types import ModuleType
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from scipy.spatial.transform import Rotation

from deux.contracts import Robot
from deux.errors import DeuxError
from deux.geometry.camera import Camera
from deux_plugins.simulators.habitat.drawing_context import FAR, NEAR, drawing_context, sensor_spec
from deux_plugins.simulators.habitat.scene_dataset import check_config, scene_file, write_config

if TYPE_CHECKING:
    from deux.contracts import SceneReference

OLDEST = (0, 2, 5)
NVIDIA_CARDS = Path("/proc/driver/nvidia/gpus")
OPENGL_FROM_OPENCV = np.diag([1.0, -1.0, -1.0])


def import_habitat() -> ModuleType:
    """The package `habitat_sim`, quiet unless the environment says how much it is to log.

    Raises:
        DeuxError: it is not installed, cannot be imported, or is too old.
    """
    _load_compiler()
    os.environ.setdefault("HABITAT_SIM_LOG", "quiet")
    os.environ.setdefault("MAGNUM_LOG", "quiet")
    try:
        import habitat_sim
    except ModuleNotFoundError as error:
        if error.name != "habitat_sim":
            raise DeuxError(
                f"habitat_sim cannot be imported: it needs {error.name}, which is not installed."
            ) from error
        raise DeuxError(
            "simulator=habitat needs Habitat-Sim, which is not installed: "
            "conda install habitat-sim headless -c conda-forge -c aihabitat"
        ) from error
    except ImportError as error:
        raise DeuxError(f"habitat_sim cannot be imported: {' '.join(str(error).split())}.") from error
    version = habitat_sim.__version__
    if tuple(int(part) for part in re.findall(r"\d+", version)[:3]) < OLDEST:
        raise DeuxError(f"habitat_sim is version {version}: simulator=habitat needs 0.2.5 or later.")
    return habitat_sim


def _load_compiler() -> None:
    """Load the compiler that torch loads with its first optimizer, before Mesa is loaded.

    Both have an LLVM of their own, and loading the compiler after Mesa crashes the process. Magnum makes Python share
    the symbols of all libraries that are loaded after it, which these two must not do either.
    """
    flags = sys.getdlopenflags()
    sys.setdlopenflags(flags & ~os.RTLD_GLOBAL)
    try:
        with suppress(ImportError):
            import triton._C.libtriton  # noqa: F401
    finally:
        sys.setdlopenflags(flags)


def choose_device(gpu: int | None) -> int:
    """Habitat-Sim's `gpu_device_id`: the CUDA index of the card that draws, -1 for the first EGL device of any kind.

    An index of a card that is not there ends the process without a Python exception, so it is refused here.

    Args:
        gpu: the index that the user asks for; None takes PyTorch's current card, and -1 where PyTorch sees none.

    Raises:
        DeuxError: there is no such card.
    """
    if gpu is None:
        return torch.cuda.current_device() if torch.cuda.is_available() else -1
    cards = max(torch.cuda.device_count(), len(list(NVIDIA_CARDS.glob("*"))))
    if not -1 <= gpu < cards:
        there = f"the cards are 0 to {cards - 1}" if cards else "there is no Nvidia card"
        raise DeuxError(f"simulator.gpu is {gpu}: {there}, and -1 takes the first device that can draw.")
    return gpu


class Session:
    """A scene that Habitat-Sim has loaded, for all robots in it and all their cameras.

    Its one agent is the camera: it stands wherever a picture is taken, its sensors at its origin. The robots' own
    places are not known here; they ask `pathfinder` how they can move.

    Args:
        scene: a scene in a file.
        camera: the first camera.
        robot: the navmesh is made for its radius, height and greatest climb.
        colors: whether colours will be asked for; without a colour sensor no texture is loaded.
        semantics: whether the scene's annotation of objects is loaded.
        gpu: as of `choose_device`.
        dataset: the user's scene dataset configuration; None writes one for this scene.
        cell_size: edge of the navmesh's cells in metres.
        cell_height: height of the navmesh's cells in metres.

    Raises:
        DeuxError: Habitat-Sim is missing, the scene cannot be loaded, or the robot fits nowhere in it.
    """

    def __init__(
        self,
        scene: SceneReference,
        camera: Camera,
        robot: Robot,
        colors: bool,
        semantics: bool,
        gpu: int | None,
        dataset: str | None,
        cell_size: float,
        cell_height: float,
    ) -> None:
        self._habitat = import_habitat()
        file = scene_file(scene)
        if not file.is_file():
            raise DeuxError(f"the file of the scene {scene.name} is missing: {file}.")
        device = choose_device(gpu)
        self._context = drawing_context(self._habitat, device)
        kinds = ("DEPTH", "COLOR") if colors else ("DEPTH",)
        agent = self._habitat.AgentConfiguration()
        agent.radius, agent.height = float(robot.radius), float(robot.height)
        agent.sensor_specifications = [sensor_spec(self._habitat, kind, camera) for kind in kinds]
        with TemporaryDirectory(prefix="deux-habitat-") as folder:
            backend = self._habitat.SimulatorConfiguration()
            backend.scene_id = str(file)
            backend.scene_dataset_config_file = str(
                check_config(dataset) if dataset else write_config(scene, Path(folder))
            )
            backend.gpu_device_id = device
            backend.enable_physics = False
            backend.load_semantic_mesh = semantics
            try:
                self._simulator = self._context.open(self._habitat.Configuration(backend, [agent]), self)
            except (RuntimeError, ValueError, AssertionError) as error:  # a failed check in C++ is the last of these
                cause = " ".join(str(error).split()).rstrip(".")
                raise DeuxError(f"Habitat-Sim cannot load the scene {scene.name} of {file}: {cause}.") from error
        self._make_navmesh(scene, robot, cell_size, cell_height)

    @property
    def pathfinder(self) -> Any:
        """Habitat-Sim's `PathFinder`, which knows the navmesh."""
        return self._simulator.pathfinder

    def snapped(self, point: np.ndarray) -> np.ndarray:
        """The point of the navmesh that is nearest to x, y, z, metres; NaN where none is near."""
        # Vectors come back as magnum's in some versions and as arrays in others.
        return np.array(self.pathfinder.snap_point(point.astype(np.float32)), np.float64)

    def moved(self, start: np.ndarray, goal: np.ndarray) -> np.ndarray:
        """Where a straight move over the navmesh ends, sliding along what is in the way; x, y, z in metres each."""
        return np.array(self.pathfinder.try_step(start.astype(np.float32), goal.astype(np.float32)), np.float64)

    @property
    def semantic_objects(self) -> list[Any]:
        """The annotated objects of the scene; none where it has no annotation."""
        scene = self._simulator.semantic_scene
        return [] if scene is None else [one for one in scene.objects if one is not None]

    def depth(self, pose: np.ndarray, camera: Camera, near: float = NEAR, far: float = FAR) -> np.ndarray:
        """Depth along the optical axis, H x W float32 in metres, 0 where nothing is hit between `near` and `far`.

        Args:
            pose: 4 x 4 camera-to-world, OpenCV axes.
            camera: its size and field of view; its range is not applied.
            near: the nearest depth in metres; what is nearer is looked through.
            far: the farthest depth in metres.
        """
        return np.array(self._draw("DEPTH", pose, camera, near, far), np.float32)

    def color(self, pose: np.ndarray, camera: Camera) -> np.ndarray:
        """The colours at a pose, H x W x 3 uint8, unlit; the sensor's fourth channel is left out."""
        return np.array(self._draw("COLOR", pose, camera)[..., :3], np.uint8)

    def semantic(self, pose: np.ndarray, camera: Camera) -> np.ndarray:
        """The `semantic_id` of the object in each pixel at a pose, H x W int64."""
        return self._draw("SEMANTIC", pose, camera).astype(np.int64)

    def _draw(self, kind: str, pose: np.ndarray, camera: Camera, near: float = NEAR, far: float = FAR) -> np.ndarray:
        self._context.free_discarded()
        spec = sensor_spec(self._habitat, kind, camera, near, far)
        # `_sensors` is there from 0.2.5 to 0.3.4. `get_sensor_observations` would draw all sensors, one pass for each.
        if spec.uuid not in self._simulator._sensors:
            self._simulator.add_sensor(spec)
        state = self._habitat.AgentState()
        state.position = pose[:3, 3].astype(np.float32)
        # A quaternion as x, y, z, w is taken by every version.
        state.rotation = [float(value) for value in Rotation.from_matrix(pose[:3, :3] @ OPENGL_FROM_OPENCV).as_quat()]
        self._simulator.get_agent(0).set_state(state)
        sensor = self._simulator._sensors[spec.uuid]
        sensor.draw_observation()
        observation: np.ndarray = sensor.get_observation()
        return observation

    def _make_navmesh(self, scene: SceneReference, robot: Robot, cell_size: float, cell_height: float) -> None:
        settings = self._habitat.NavMeshSettings()
        settings.set_defaults()
        settings.cell_size, settings.cell_height = float(cell_size), float(cell_height)
        settings.agent_radius, settings.agent_height = float(robot.radius), float(robot.height)
        settings.agent_max_climb = float(robot.max_climb)
        pathfinder = self._simulator.pathfinder
        # A .navmesh beside the scene is loaded by itself, whatever body it was made for.
        if pathfinder.is_loaded and pathfinder.nav_mesh_settings == settings:
            return
        if not self._simulator.recompute_navmesh(pathfinder, settings) or not pathfinder.is_loaded:
            raise DeuxError(
                f"{scene.name} has no navmesh: a robot of radius {robot.radius} m and height {robot.height} m fits "
                "nowhere in it."
            )
