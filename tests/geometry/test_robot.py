import pytest

from deux.errors import DeuxError
from deux.geometry.robot import Robot


def test_the_defaults_are_the_papers_robot():
    robot = Robot()
    assert (robot.radius, robot.height, robot.camera_height) == (0.1, 1.5, 1.25)
    assert (robot.forward_step, robot.turn_angle) == (0.25, 10.0)


@pytest.mark.parametrize(
    ("name", "value"),
    [("radius", -0.1), ("height", 0.0), ("camera_height", 0.0), ("forward_step", 0.0), ("turn_angle", 180.0)],
)
def test_impossible_bodies_are_named(name, value):
    with pytest.raises(DeuxError, match=rf"robot\.{name} is {value}: it must be"):
        Robot(**{name: value})


def test_a_robot_that_climbs_its_own_height_would_meet_no_obstacle():
    Robot(height=0.3, camera_height=0.2)
    with pytest.raises(DeuxError, match=r"robot\.max_climb is 0\.2 and robot\.height 0\.2"):
        Robot(height=0.2, camera_height=0.18)


def test_a_camera_above_the_body_would_see_through_what_the_body_passes_under():
    Robot(height=1.0, camera_height=1.0)
    for sizes in ({"height": 0.3}, {"camera_height": 2.9}):
        with pytest.raises(
            DeuxError, match=r"robot\.camera_height is .* and robot\.height .*: a camera above the body"
        ):
            Robot(**sizes)
