"""A stand-in for the package habitat_sim: its types, shapes, values and refusals, of versions 0.2.5 to 0.3.3.

A scene is a room with boxes in it, in a file of JSON whatever its suffix says:

    {"size": [6.0, 2.5, 5.0], "up": "y", "boxes": [{"low": [x, y, z], "high": [x, y, z], "category": "chair"}, ...]}

`size`, `low` and `high` are in metres in a Y-up frame from the room's corner; `up` is the axis in which the file itself
is written, so that a reader who takes it for another one sees the room lying on its side.
"""

import enum
import json
import math
import threading
import weakref
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType
from typing import Any, ClassVar, Literal

import numpy as np
from habitat_stand_in_room import Box, Rectangle, cast, navmesh
from scipy.spatial.transform import Rotation

Vectors = Literal["magnum", "numpy"]

FILE_FROM_Y_UP = {"y": np.eye(3), "z": np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])}
GUESSED_AXES = {"up": [0.0, 0.0, 1.0], "front": [0.0, 1.0, 0.0]}  # without a configuration
DEFAULT_AXES = {"up": [0.0, 1.0, 0.0], "front": [0.0, 0.0, -1.0]}  # of a configuration that does not say
SUBSTEP = 0.001  # metres


class Vector3:
    """magnum.Vector3 as far as it is used: a sequence of three numbers that is no array."""

    def __init__(self, x: float, y: float, z: float) -> None:
        self._values = tuple(float(np.float32(value)) for value in (x, y, z))

    def __len__(self) -> int:
        return 3

    def __getitem__(self, index: int) -> float:
        return self._values[index]


class Quaternion:
    """magnum.Quaternion: an agent's state refuses it."""


class SensorType(enum.Enum):
    COLOR = 1
    DEPTH = 2
    SEMANTIC = 4


class SensorSubType(enum.Enum):
    PINHOLE = 1
    ORTHOGRAPHIC = 2


class Typed:
    """Attributes that C++ holds: a name that is not there and a value of the wrong type raise."""

    kinds: ClassVar[dict[str, type]]

    def __setattr__(self, name: str, value: Any) -> None:
        if name not in self.kinds:
            raise AttributeError(f"{type(self).__name__} has no attribute {name}")
        kind = self.kinds[name]
        if kind is tuple:  # a vector of floats
            if not (len(value) == 3 and all(isinstance(entry, (float, np.floating)) for entry in value)):
                raise TypeError(f"{name}: incompatible function arguments: {value}")
        elif kind is list:  # a vector of integers
            if not (len(value) == 2 and all(isinstance(entry, (int, np.integer)) for entry in value)):
                raise TypeError(f"{name}: incompatible function arguments: {value}")
        elif kind is float:
            if isinstance(value, bool) or not isinstance(value, (int, float)):
                raise TypeError(f"{name}: incompatible function arguments: {value}")
        elif not isinstance(value, kind):
            raise TypeError(f"{name}: incompatible function arguments: {value}")
        object.__setattr__(self, name, value)


class CameraSensorSpec(Typed):
    kinds: ClassVar = {
        "uuid": str,
        "sensor_type": SensorType,
        "sensor_subtype": SensorSubType,
        "resolution": list,
        "hfov": float,
        "near": float,
        "far": float,
        "position": tuple,
        "orientation": tuple,
    }

    def __init__(self) -> None:
        self.uuid, self.sensor_type, self.sensor_subtype = "rgba_camera", SensorType.COLOR, SensorSubType.PINHOLE
        self.resolution, self.hfov, self.near, self.far = [128, 128], 90.0, 0.01, 1000.0
        self.position, self.orientation = [0.0, 1.5, 0.0], [0.0, 0.0, 0.0]


class SimulatorConfiguration(Typed):
    kinds: ClassVar = {
        "scene_id": str,
        "scene_dataset_config_file": str,
        "gpu_device_id": int,
        "allow_sliding": bool,
        "enable_physics": bool,
        "load_semantic_mesh": bool,
        "random_seed": int,
    }

    def __init__(self) -> None:
        self.scene_id, self.scene_dataset_config_file, self.gpu_device_id = "", "default", 0
        self.allow_sliding, self.enable_physics, self.load_semantic_mesh, self.random_seed = True, False, True, 0


class NavMeshSettings(Typed):
    kinds: ClassVar = dict.fromkeys(
        ("cell_size", "cell_height", "agent_radius", "agent_height", "agent_max_climb"), float
    )

    def __init__(self) -> None:
        self.set_defaults()

    def set_defaults(self) -> None:
        self.cell_size, self.cell_height = 0.05, 0.2
        self.agent_radius, self.agent_height, self.agent_max_climb = 0.1, 1.5, 0.2

    def __eq__(self, other: object) -> bool:
        return isinstance(other, NavMeshSettings) and vars(self) == vars(other)

    __hash__ = None  # type: ignore[assignment]


@dataclass
class AgentConfiguration:
    height: float = 1.5
    radius: float = 0.1
    sensor_specifications: list[CameraSensorSpec] = field(default_factory=list)


@dataclass
class Configuration:
    sim_cfg: SimulatorConfiguration
    agents: list[AgentConfiguration]


@dataclass
class AgentState:
    position: Any = field(default_factory=lambda: np.zeros(3, np.float32))
    rotation: Any = field(default_factory=lambda: [0.0, 0.0, 0.0, 1.0])


class Agent:
    """The only agent; its sensors are at the pose that its state and their own position give."""

    def __init__(self) -> None:
        self.position, self.rotation = np.zeros(3), np.eye(3)

    def set_state(
        self, state: AgentState, reset_sensors: bool = True, infer_sensor_states: bool = True, is_initial: bool = False
    ) -> None:
        """Stand anywhere, off the navmesh too; nothing is snapped."""
        if isinstance(state.rotation, Quaternion) or len(state.rotation) != 4:
            raise TypeError(f"rotation must be x, y, z, w or a numpy quaternion, not {state.rotation}")
        if not math.isclose(np.linalg.norm(state.rotation), 1.0, abs_tol=1e-5):
            raise ValueError("rotation must be of unit length")
        if not np.isfinite(state.position).all():
            raise ValueError("position must be finite")
        self.position = np.asarray(state.position, np.float32).astype(np.float64)
        self.rotation = Rotation.from_quat(state.rotation).as_matrix()


class Sensor:
    """Draws the room by casting a ray through the middle of each pixel; back faces are not seen."""

    def __init__(self, simulator: "Simulator", spec: CameraSensorSpec) -> None:
        self._simulator, self._spec = simulator, spec
        self._observation: np.ndarray | None = None

    def draw_observation(self) -> None:
        if self._simulator._context() is None:
            raise SystemExit("the process ends here: its OpenGL context is gone")
        self._observation = self._draw()

    def get_observation(self) -> np.ndarray:
        assert self._observation is not None, "nothing was drawn"
        return self._observation.copy()

    def _draw(self) -> np.ndarray:
        height, width = self._spec.resolution
        focal = width / 2.0 / math.tan(math.radians(self._spec.hfov) / 2.0)
        u, v = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
        # OpenGL axes: x right, y up, the camera looks along -z.
        rays = np.stack([(u - width / 2.0) / focal, -(v - height / 2.0) / focal, -np.ones(u.shape)], axis=-1)
        agent = self._simulator.get_agent(0)
        origin = agent.position + agent.rotation @ np.array(self._spec.position)
        rays = rays.reshape(-1, 3) @ agent.rotation.T
        semantic = self._spec.sensor_type is SensorType.SEMANTIC
        boxes = self._simulator.semantic_boxes if semantic else self._simulator.boxes
        depth, number = cast(boxes, origin, rays, self._spec.near, self._spec.far)
        shape = (height, width)
        if semantic:
            return number.astype(np.uint32).reshape(shape)
        if self._spec.sensor_type is SensorType.DEPTH:
            return np.where(np.isfinite(depth), depth, 0.0).astype(np.float32).reshape(shape)
        hit = np.isfinite(depth)
        points = origin + rays * np.where(hit, depth, 0.0)[:, None]
        pattern = (np.floor(points / 0.25 + 1e-4).sum(axis=1) % 2.0) * 60.0
        rgba = np.stack([80.0 + pattern, 90.0 + 20.0 * number, 180.0 - pattern, np.full(len(rays), 255.0)], axis=1)
        rgba[~hit, :3] = 0.0
        return rgba.astype(np.uint8).reshape(*shape, 4)


class PathFinder:
    """The navmesh of a room: rectangles a robot's radius away from all that is too high to climb."""

    def __init__(self, vectors: Vectors) -> None:
        self._vectors = vectors
        self.rectangles: list[Rectangle] = []
        self.nav_mesh_settings = NavMeshSettings()

    @property
    def is_loaded(self) -> bool:
        return bool(self.rectangles)

    @property
    def num_islands(self) -> int:
        return max((one.island for one in self.rectangles), default=-1) + 1

    def build_navmesh_vertices(self, island_index: int = -1) -> list[Any]:
        return [
            self._vector((x, one.y, z))
            for one in self._of(island_index)
            for x, z in ((one.x0, one.z0), (one.x1, one.z0), (one.x1, one.z1), (one.x0, one.z1))
        ]

    def build_navmesh_vertex_indices(self, island_index: int = -1) -> list[int]:
        count = len(self._of(island_index))
        return [4 * number + corner for number in range(count) for corner in (0, 1, 2, 0, 2, 3)]

    def snap_point(self, point: Any, island_index: int = -1) -> Any:
        """The nearest point; NaN where none is within 4 m."""
        x, y, z = _triple(point)
        nearest = [
            np.array([np.clip(x, one.x0, one.x1), one.y, np.clip(z, one.z0, one.z1)]) for one in self._of(island_index)
        ]
        distances = [float(np.linalg.norm(candidate - (x, y, z))) for candidate in nearest]
        if not distances or min(distances) > 4.0:
            return self._vector((math.nan, math.nan, math.nan))
        return self._vector(nearest[int(np.argmin(distances))])

    def try_step(self, start: Any, end: Any) -> Any:
        """Move straight, and along an axis where the way is barred; from off the navmesh there is no way."""
        begin, goal = _triple(start), _triple(end)
        steps = max(1, math.ceil(float(np.linalg.norm(goal - begin)) / SUBSTEP))
        dx, _, dz = (goal - begin) / steps
        x, y, z = begin
        barred = False
        for _ in range(steps):
            for step_x, step_z in ((dx, dz), (dx, 0.0), (0.0, dz)):
                if self._covers(x + step_x, y, z + step_z):
                    x, z = x + step_x, z + step_z
                    break
                barred = True
            else:
                break
        return self._vector((x, y, z) if barred else (goal[0], y, goal[2]))

    def _covers(self, x: float, y: float, z: float) -> bool:
        margin = 1e-6
        return any(
            one.x0 - margin <= x <= one.x1 + margin and one.z0 - margin <= z <= one.z1 + margin and abs(one.y - y) < 0.1
            for one in self.rectangles
        )

    def _of(self, island: int) -> list[Rectangle]:
        return [one for one in self.rectangles if island in (-1, one.island)]

    def _vector(self, values: Any) -> Any:
        return Vector3(*values) if self._vectors == "magnum" else np.array([*values], np.float32)


@dataclass(frozen=True)
class SemanticCategory:
    text: str

    def name(self, mapping: str = "") -> str:
        return self.text


@dataclass(frozen=True)
class SemanticObject:
    semantic_id: int
    category: SemanticCategory | None


@dataclass(frozen=True)
class SemanticScene:
    objects: list[SemanticObject]


class Context:
    """The OpenGL context of a process."""


class Simulator:
    """One open scene."""

    vectors: Vectors = "magnum"
    cards = 0
    current_context: ClassVar[Any] = staticmethod(lambda: None)
    navmesh_loaded = False  # a .navmesh, made for another body, lies beside the scene

    def __init__(self, config: Configuration) -> None:
        backend = config.sim_cfg
        if not -1 <= backend.gpu_device_id < self.cards:
            raise SystemExit("the process ends here: no EGL device has this CUDA index")
        # A context that is there is taken; it is gone with the simulator that made it.
        context = type(self).current_context()
        self._owned = None if context else Context()
        self._context = weakref.ref(context or self._owned)
        type(self).current_context = self._context
        scene = Path(backend.scene_id)
        empty = {"size": [0.0, 0.0, 0.0], "up": "y", "boxes": []}
        described = empty if backend.scene_id == "NONE" else json.loads(scene.read_text())
        attributes = _stage_attributes(scene, backend.scene_dataset_config_file)
        turn = FILE_FROM_Y_UP[described["up"]]
        size = np.array(described["size"])
        boxes = [Box(np.zeros(3), size, "room", 0)] + [
            Box(np.array(box["low"]), np.array(box["high"]), box["category"], number)
            for number, box in enumerate(described["boxes"], start=1)
        ]
        world = _world_from_file(attributes["up"], attributes["front"]) @ turn
        self.boxes = [box.turned(world) for box in boxes]
        semantic, self.semantic_scene = attributes.get("semantic_asset"), SemanticScene([])
        self.semantic_boxes: list[Box] = []
        if semantic and backend.load_semantic_mesh:
            # The reader of .ply turns it to Y-up, whatever the configuration says next.
            read = np.eye(3) if semantic.endswith(".ply") else turn
            up, front = (attributes.get(f"semantic_{axis}", attributes[axis]) for axis in ("up", "front"))
            self.semantic_boxes = [box.turned(_world_from_file(up, front) @ read) for box in boxes]
            assert Path(attributes["semantic_descriptor_filename"]).is_file()
            self.semantic_scene = SemanticScene(
                [SemanticObject(0, SemanticCategory("Unknown"))]
                + [SemanticObject(box.number, SemanticCategory(box.category)) for box in boxes[1:]]
            )
        self._thread = threading.get_ident()
        self._agent = Agent()
        self._loaded = {SensorType.DEPTH, SensorType.SEMANTIC}
        self._loaded |= {spec.sensor_type for agent in config.agents for spec in agent.sensor_specifications}
        self._sensors: dict[str, Sensor] = {}
        for spec in config.agents[0].sensor_specifications:
            self.add_sensor(spec)
        self.pathfinder = PathFinder(self.vectors)
        if self.navmesh_loaded:
            other = NavMeshSettings()
            other.agent_radius = 0.4
            self.recompute_navmesh(self.pathfinder, other)

    def close(self, destroy: bool = True) -> None:
        """Free the scene, and the context if it is this one's."""
        if threading.get_ident() != self._thread:
            raise SystemExit("the process ends here: no OpenGL context is current in this thread")
        self._owned = None

    def get_agent(self, agent_id: int) -> Agent:
        return [self._agent][agent_id]

    def add_sensor(self, sensor_spec: CameraSensorSpec, agent_id: int | None = None) -> None:
        if sensor_spec.sensor_type not in self._loaded:
            raise ValueError(f"Data for {sensor_spec.sensor_type} sensor was not loaded during Simulator init.")
        if sensor_spec.uuid in self._sensors:
            raise ValueError(f"Sensor {sensor_spec.uuid} already exists")
        self._sensors[sensor_spec.uuid] = Sensor(self, sensor_spec)

    def recompute_navmesh(self, pathfinder: PathFinder, settings: NavMeshSettings) -> bool:
        pathfinder.rectangles = navmesh(
            self.boxes,
            settings.cell_size,
            settings.agent_radius,
            settings.agent_height,
            settings.agent_max_climb,
            settings.cell_height,
        )
        pathfinder.nav_mesh_settings = settings
        return pathfinder.is_loaded


def make_habitat_sim(vectors: Vectors = "magnum", version: str = "0.3.3", **attributes: Any) -> ModuleType:
    """The package, with the vectors that a version returns; `attributes` are those of `Simulator`."""
    module = ModuleType("habitat_sim")
    module.__dict__.update(
        __version__=version,
        SensorType=SensorType,
        SensorSubType=SensorSubType,
        CameraSensorSpec=CameraSensorSpec,
        SimulatorConfiguration=SimulatorConfiguration,
        NavMeshSettings=NavMeshSettings,
        AgentConfiguration=AgentConfiguration,
        Configuration=Configuration,
        AgentState=AgentState,
        PathFinder=PathFinder,
        Simulator=type("Simulator", (Simulator,), {"vectors": vectors, **attributes}),
    )
    return module


def _stage_attributes(scene: Path, config_file: str) -> dict[str, Any]:
    """What is known of a scene's axes and annotation; a scene that no configuration lists is guessed about."""
    if config_file == "default":
        return dict(GUESSED_AXES)
    config = json.loads(Path(config_file).read_text())
    stages = config["stages"]
    if str(scene) not in stages["paths"][scene.suffix]:
        return dict(GUESSED_AXES)
    return {**DEFAULT_AXES, **stages["default_attributes"]}


def _world_from_file(up: list[float], front: list[float]) -> np.ndarray:
    return np.stack([np.cross(front, up), np.array(up), -np.array(front)])


def _triple(point: Any) -> np.ndarray:
    values = np.array([point[0], point[1], point[2]], np.float32).astype(np.float64)
    if len(point) != 3:
        raise TypeError("incompatible function arguments")
    return values
