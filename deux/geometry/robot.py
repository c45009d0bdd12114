"""Body and motion of the robot, used by simulators, maps and explorers."""

from dataclasses import dataclass

from deux.errors import DeuxError, check_range


@dataclass(frozen=True)
class Robot:
    """Body and motion of the robot, in metres and degrees.

    Args:
        radius: radius of the body, a vertical cylinder.
        height: height of the body, which is also the clearance that free floor needs.
        camera_height: height of the camera above the floor, at most `height`.
        forward_step: length of one forward action.
        turn_angle: angle of one turn action.
        max_climb: highest step that the robot can climb, lower than `height`; only what lies between the two heights is
            an obstacle.

    Raises:
        DeuxError: a value is out of range.
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
                "would pass through door frames and ceilings, so increase robot.height or decrease "
                "robot.camera_height."
            )
        if self.max_climb >= self.height:
            raise DeuxError(
                f"robot.max_climb is {self.max_climb} and robot.height {self.height}: with steps as "
                "high as the robot nothing is an obstacle, so decrease robot.max_climb."
            )
