"""Simulator of a room with boxes, without a mesh and with exact depth images, for tests of explorers."""

import math
from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from deux.contracts import Action, Channel, Channels, Floor, Frame, Robot, SceneReference, Simulator
from deux.errors import DeuxError
from deux.geometry.camera import Camera
from deux.geometry.grid import FreeSpace, GridFrame
from deux.geometry.poses import camera_pose


@dataclass(frozen=True)
class Box:
    """An axis-aligned box on the floor, in metres.

    Args:
        x0: minimum x.
        z0: minimum z.
        x1: maximum x.
        z1: maximum z.
        height: height of its top above the floor. A box of the room's height, 2.5, is a wall.
    """

    x0: float
    z0: float
    x1: float
    z1: float
    height: float = 2.5


@dataclass(frozen=True)
class BoxScene(SceneReference):
    """Scene reference of a box world, which exists in memory only. See `BoxWorld` for the arguments."""

    width: float
    length: float
    boxes: tuple[Box, ...]

    @property
    def identity(self) -> str:
        """All dimensions of the world."""
        return f"boxes:{self.width}:{self.length}:{self.boxes}"


class BoxWorld(Simulator):
    """A simulator of a closed rectangular room with boxes.

    The floor is at y = 0 and the ceiling at 2.5 m. Depth is the intersection of each pixel's ray with room and boxes.
    The robot slides along obstacles, one axis at a time. Before the first `reset` it is at the centre of the room.

    Args:
        width: size of the room along x in metres; x is in [0, width].
        length: size of the room along z in metres; z is in [0, length].
        boxes: boxes in the room; boxes of full height divide it into several rooms.
        camera: the robot's camera.
        robot: the robot's body and motion.
    """

    ceiling = 2.5
    label_names: tuple[str, ...] = ("room", "box")

    def __init__(
        self,
        width: float,
        length: float,
        boxes: tuple[Box, ...] = (),
        camera: Camera | None = None,
        robot: Robot | None = None,
    ) -> None:
        self.width = width
        self.length = length
        self.boxes = boxes
        self.scene = BoxScene("boxes", width, length, boxes)
        self.floors = (Floor(0.0, width * length),)
        self.camera = camera or Camera(width=64, height=64)
        self.robot = robot or Robot()
        blocking = [box for box in boxes if box.height > self.robot.max_climb]
        self._blocking = np.array([(box.x0, box.z0, box.x1, box.z1) for box in blocking]).reshape(-1, 4)
        self._rays = self.camera.rays()
        self._x, self._z, self._yaw = width / 2.0, length / 2.0, 0.0

    @property
    def object_labels(self) -> tuple[str, ...]:
        """Label of each box."""
        return ("box",) * len(self.boxes)

    def reset(self, x: float, z: float, yaw: float, floor: int = 0) -> None:
        """Place the robot at world (x, z) in metres with heading `yaw` in radians; 0 looks along -Z.

        Raises:
            DeuxError: the robot does not fit there, or the floor does not exist.
        """
        self._check_floor(floor)
        if self.clearance(x, z) < self.robot.radius:
            raise DeuxError(f"the robot cannot stand at x={x:.3f}, z={z:.3f} in {self.scene.name}: something is there.")
        self._x, self._z, self._yaw = x, z, yaw

    @property
    def pose(self) -> np.ndarray:
        """The current camera-to-world matrix, 4 x 4 float64."""
        return camera_pose(self._x, self.robot.camera_height, self._z, self._yaw)

    def step(self, action: Action) -> bool:
        """Execute an action and return whether a collision shortened it."""
        turn = math.radians(self.robot.turn_angle)
        if action is Action.LEFT:
            self._yaw += turn
        if action is Action.RIGHT:
            self._yaw -= turn
        if action is not Action.FORWARD:
            return False
        touched = False
        pieces = 10
        length = self.robot.forward_step / pieces
        for _ in range(pieces):
            dx, dz = -math.sin(self._yaw) * length, -math.cos(self._yaw) * length
            for step_x, step_z in ((dx, dz), (dx, 0.0), (0.0, dz)):
                if self.clearance(self._x + step_x, self._z + step_z) >= self.robot.radius:
                    self._x, self._z = self._x + step_x, self._z + step_z
                    break
                touched = True
        return touched

    def clearance(self, x: np.ndarray | float, z: np.ndarray | float) -> np.ndarray:
        """Distance in metres from floor points to the nearest wall or box that blocks the robot; negative inside."""
        x, z = np.asarray(x)[..., None], np.asarray(z)[..., None]
        x0, z0, x1, z1 = self._blocking.T
        apart_x, apart_z = np.maximum(x0 - x, x - x1), np.maximum(z0 - z, z - z1)
        outside = np.hypot(np.maximum(apart_x, 0.0), np.maximum(apart_z, 0.0))
        boxes = outside + np.minimum(np.maximum(apart_x, apart_z), 0.0)
        return np.concatenate([x, self.width - x, z, self.length - z, boxes], axis=-1).min(axis=-1)

    def render(self, poses: np.ndarray, channels: Channels) -> list[Frame]:
        """Render depth and labels by ray casting, with patterned colours that differ between the room and the boxes."""
        return [self._frame(pose, channels) for pose in poses]

    def _frame(self, pose: np.ndarray, channels: Channels) -> Frame:
        directions = self._rays @ pose[:3, :3].T
        depth = self._leave(pose[:3, 3], directions, (0.0, 0.0, 0.0), (self.width, self.ceiling, self.length))
        objects = np.full(depth.shape, -1, np.int32)
        for number, box in enumerate(self.boxes):
            entry = self._enter(pose[:3, 3], directions, (box.x0, 0.0, box.z0), (box.x1, box.height, box.z1))
            objects[entry < depth] = number
            depth = np.minimum(depth, entry)
        ids = (objects >= 0).astype(np.int32)
        points = pose[:3, 3] + directions * depth[..., None]
        pattern = (np.floor(points / 0.25).sum(axis=-1) % 2.0) * 60.0
        rgb = np.stack([80.0 + pattern, 120.0 + 50.0 * ids, 180.0 - pattern], axis=-1).astype(np.uint8)
        in_range = (depth >= self.camera.min_depth) & (depth <= self.camera.max_depth)
        depth = np.where(in_range, depth, 0.0).astype(np.float32)
        objects[~in_range] = -1
        return Frame(
            rgb if Channel.COLOR in channels else np.zeros((0, 0, 3), np.uint8),
            depth,
            pose.copy(),
            ids if Channel.LABELS in channels else None,
            objects if Channel.OBJECTS in channels else None,
        )

    def another(self, camera: Camera | None = None) -> "BoxWorld":
        """Create another simulator of the same world, with the robot in the centre."""
        return BoxWorld(self.width, self.length, self.boxes, camera or self.camera, self.robot)

    def free_space(self, floor: int = 0) -> FreeSpace:
        """Compute the free space that is connected to the robot's position, on a grid with cells of 5 cm.

        Raises:
            DeuxError: the floor does not exist.
        """
        self._check_floor(floor)
        frame = GridFrame(0.0, 0.0, math.ceil(self.length / 0.05), math.ceil(self.width / 0.05))
        rows, columns = np.mgrid[: frame.rows, : frame.columns]
        clearance = self.clearance((columns + 0.5) * frame.resolution, (rows + 0.5) * frame.resolution)
        here = frame.cell(self._x, self._z)
        free = clearance >= self.robot.radius
        free[here] = True
        regions, _ = ndimage.label(free)
        return FreeSpace(frame, regions == regions[here], clearance.astype(np.float32), 0.0)

    def _check_floor(self, floor: int) -> None:
        if floor != 0:
            raise DeuxError(f"{self.scene.name} has no floor {floor}: its only floor is 0.")

    @staticmethod
    def _slabs(
        origin: np.ndarray, directions: np.ndarray, low: tuple[float, ...], high: tuple[float, ...]
    ) -> tuple[np.ndarray, np.ndarray]:
        """Ray parameters at which each ray enters and leaves an axis-aligned box."""
        safe = np.where(np.abs(directions) < 1e-12, 1e-12, directions)
        enters, leaves = np.array(-np.inf), np.array(np.inf)
        for axis in range(3):  # three times as fast as a reduction over a last axis of size 3
            a, b = (low[axis] - origin[axis]) / safe[..., axis], (high[axis] - origin[axis]) / safe[..., axis]
            enters, leaves = np.maximum(enters, np.minimum(a, b)), np.minimum(leaves, np.maximum(a, b))
        return enters, leaves

    @classmethod
    def _leave(
        cls, origin: np.ndarray, directions: np.ndarray, low: tuple[float, ...], high: tuple[float, ...]
    ) -> np.ndarray:
        """Depth at which rays from inside leave a box."""
        return cls._slabs(origin, directions, low, high)[1]

    @classmethod
    def _enter(
        cls, origin: np.ndarray, directions: np.ndarray, low: tuple[float, ...], high: tuple[float, ...]
    ) -> np.ndarray:
        """Depth at which rays from outside enter a box, inf where they miss it."""
        near, far = cls._slabs(origin, directions, low, high)
        return np.where((near <= far) & (far > 0.0), np.maximum(near, 0.0), np.inf)
