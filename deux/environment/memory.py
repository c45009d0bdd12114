"""Memory of a learned explorer: the map and the last action of an episode, used in training and in collection."""

import numpy as np

from deux.contracts import Action, Experience, Frame, Observation, Robot
from deux.environment.egocentric import Crops, egocentric_crop
from deux.geometry.camera import Camera
from deux.mapping.occupancy import OccupancyMap

MOVES = (Action.FORWARD, Action.LEFT, Action.RIGHT)
"""Actions of learned explorers, which never stop an episode."""

RESOLUTION = 0.1
"""Edge of a map cell in metres; as in exploring_exploration."""


class ExplorationMemory:
    """Occupancy map and last action of one episode, and the policy's observation of both.

    Args:
        camera: camera of the depth images.
        robot: body of the robot.
        crops: sizes of the map crops.
        resolution: edge of a map cell in metres.
    """

    def __init__(self, camera: Camera, robot: Robot, crops: Crops, resolution: float = RESOLUTION) -> None:
        self.crops = crops
        self.occupancy = OccupancyMap(camera, robot, resolution)
        self._least_move = 0.25 * robot.forward_step
        self._pose: np.ndarray | None = None
        self._collided = False
        self._action: Action | None = None
        self._steps = 0

    def experience(self, frame: Frame, collided: bool) -> Experience:
        """Add a frame and return the input of rewards.

        Args:
            frame: the observed frame, with labels if the reward needs them.
            collided: whether the last action was shortened by an obstacle.
        """
        self.see(frame.depth, frame.pose, collided)
        observation = Observation(
            self._steps, frame.pose, collided, frame.rgb, sensor_depth=frame.depth, labels=frame.labels
        )
        action = None if self._action is None else int(self._action)
        known = self.occupancy
        return Experience(observation, action, known.frame, known.cells, known.views, known.seen, self.view())

    @property
    def area(self) -> float:
        """Known area of the map, free or occupied, in square metres."""
        return float(np.count_nonzero(self.occupancy.cells)) * self.occupancy.resolution**2

    def see(self, depth: np.ndarray, pose: np.ndarray, collided: bool) -> None:
        """Add a frame to the map.

        Args:
            depth: H x W metres, 0 = none.
            pose: 4 x 4 camera-to-world.
            collided: whether the last action was shortened by an obstacle.
        """
        self.occupancy.update(depth, pose)
        if self._action is Action.FORWARD and self._pose is not None:
            moved = np.hypot(*(pose[[0, 2], 3] - self._pose[[0, 2], 3]))
            if moved < self._least_move:
                self.occupancy.mark_contact(pose)
        self._pose, self._collided = pose, collided

    def acted(self, action: Action) -> None:
        """Record the action after the last frame, including those that the policy did not choose."""
        self._action = action
        self._steps += 1

    def view(self) -> dict[str, np.ndarray]:
        """The observation of the policy.

        Returns:
            "near" and "far", the crops of the map, each 4 x pixels x pixels uint8; and "body", 4 float32: the last
            action, one-hot over `MOVES`, and whether it collided.
        """
        assert self._pose is not None
        known, crops = self.occupancy, self.crops
        body = [*(float(self._action is move) for move in MOVES), float(self._collided)]
        edges = {"near": crops.near, "far": crops.far}
        view = {
            name: egocentric_crop(known.cells, known.visited, known.frame, self._pose, edge, crops.pixels)
            for name, edge in edges.items()
        }
        return {**view, "body": np.array(body, np.float32)}
