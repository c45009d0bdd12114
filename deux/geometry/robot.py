"""The robot's body and motion, which the simulator moves, maps leave room for and explorers plan with."""

from dataclasses import dataclass

from deux.errors import DeuxError, check_range


@dataclass(frozen=True)
class Robot:
    """The robot's body and motion, in metres and degrees.

    Args:
        radius: radius of the body, a vertical cylinder.
        height: height of the body, which is all that the free floor leaves room for.
        camera_height: height of the camera above the floor, not above the body.
        forward_step: length of one forward action.
        turn_angle: angle of one turn in degrees.
        max_climb: highest step in the floor that the robot rolls over; lower than the body, for only what lies between
            the two is an obstacle.

    Raises:
        DeuxError: a value is out of its range.
    """

    radius: float = 0.1
    height: float = 1.5
    camera_height: float = 1.25
    forward_step: float = 0.25
    turn_angle: float = 10.0
    max_climb: float = 0.2

    def __post_init__(self) -> None:
        check_range("robot.radius", self.radius, 0)
        check_range("robot.height", self.height, 0, ends=False)
        check_range("robot.camera_height", self.camera_height, 0, ends=False)
        check_range("robot.forward_step", self.forward_step, 0, ends=False)
        check_range("robot.turn_angle", self.turn_angle, 0, 180, ends=False)
        check_range("robot.max_climb", self.max_climb, 0)
        if self.camera_height > self.height:
            raise DeuxError(
                f"robot.camera_height is {self.camera_height} and robot.height {self.height}: a camera above the body "
                "would pass through door frames, table tops and ceilings, so set robot.height to at least as much, or "
                "robot.camera_height to less."
            )
        if self.max_climb >= self.height:
            raise DeuxError(
                f"robot.max_climb is {self.max_climb} and robot.height {self.height}: a robot that climbs what is as "
                "high as itself meets no obstacle, so robot.max_climb must be lower."
            )
