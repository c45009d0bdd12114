import numpy as np
import pytest

from deux.contracts import COLOR, DEPTH, Action, Channel, Simulator
from deux.errors import DeuxError
from deux.geometry.camera import Camera
from deux.testing.box_world import Box, BoxWorld
from deux.testing.simulators import SimulatorSuite


class TestBoxWorld(SimulatorSuite):
    def make_simulator(self, camera: Camera) -> Simulator:
        return BoxWorld(6.0, 5.0, (Box(4.0, 1.0, 5.0, 2.0, 0.9), Box(1.0, 3.5, 2.0, 4.0)), camera)


def test_depth_of_an_empty_room_is_the_distance_to_its_planes():
    world = BoxWorld(4.0, 6.0, camera=Camera(65, 65))
    world.reset(1.0, 2.5, 0.0)
    depth = world.observe().depth
    assert depth[32, 32] == pytest.approx(2.5)
    assert depth[32, 0] == pytest.approx(1.0 / (32 / 32.5), rel=1e-5)
    assert depth[64, 32] == pytest.approx(1.25 / (32 / 32.5), rel=1e-5)
    world.step(Action.LEFT)
    world.reset(1.0, 2.5, np.pi / 2.0)
    assert world.observe().depth[32, 32] == pytest.approx(1.0), "left of -Z is -X"


def test_points_of_the_depth_image_lie_on_the_surfaces_that_are_labelled():
    box = Box(2.0, 0.5, 3.0, 1.5, 0.9)
    world = BoxWorld(5.0, 4.0, (box,))
    world.reset(2.3, 3.0, 0.2)
    frame = world.observe(COLOR | {Channel.LABELS, Channel.OBJECTS})
    points = (world.camera.rays() * frame.depth[..., None]) @ frame.pose[:3, :3].T + frame.pose[:3, 3]
    room = np.minimum.reduce(
        [np.abs(points[..., i] - side) for i, high in ((0, 5.0), (1, 2.5), (2, 4.0)) for side in (0.0, high)]
    )
    assert room[frame.labels == 0].max() < 1e-5
    faces = np.minimum.reduce(
        [
            np.abs(points[..., i] - side)
            for i, sides in ((0, (2.0, 3.0)), (1, (0.9,)), (2, (0.5, 1.5)))
            for side in sides
        ]
    )
    assert (frame.labels == 1).sum() > 100
    np.testing.assert_array_equal(frame.objects, frame.labels - 1)
    assert faces[frame.labels == 1].max() < 1e-5


def test_the_robot_never_enters_what_blocks_it_and_slides_along_it():
    world = BoxWorld(3.0, 3.0, (Box(1.0, 0.0, 2.0, 1.0, 0.5),))
    world.reset(1.5, 1.6, np.radians(20.0))
    touched = [world.step(Action.FORWARD) for _ in range(8)]
    assert any(touched)
    assert world.clearance(world.pose[0, 3], world.pose[2, 3]) >= world.robot.radius - 1e-9
    assert world.pose[0, 3] < 1.4, "it slid to the left along the box"


def test_free_space_is_what_the_robot_can_reach():
    world = BoxWorld(4.0, 2.0, (Box(1.9, 0.0, 2.1, 2.0),))
    world.reset(1.0, 1.0, 0.0)
    space = world.free_space()
    assert space.area == pytest.approx((1.9 - 0.2) * (2.0 - 0.2), rel=0.06)
    assert not space.free[:, 40:].any()


def test_there_is_no_place_within_a_radius_of_what_blocks_the_robot():
    world = BoxWorld(4.0, 4.0, (Box(1.0, 1.0, 2.0, 2.0, 0.5), Box(3.0, 3.0, 3.5, 3.5, 0.1)))
    for x, z in ((1.5, 1.5), (0.95, 1.5), (0.05, 2.0), (-1.0, 2.0)):
        with pytest.raises(DeuxError, match="cannot stand"):
            world.reset(x, z, 0.0)
    world.reset(3.2, 3.2, 0.0)  # it rolls over what is low


def test_different_rooms_have_different_identities():
    rooms = [BoxWorld(4.0, 4.0), BoxWorld(4.0, 4.5), BoxWorld(4.0, 4.0, (Box(1.0, 1.0, 2.0, 2.0),))]
    assert len({room.scene.identity for room in rooms}) == 3
    assert rooms[0].another().scene == rooms[0].scene


def test_what_is_drawn_does_not_depend_on_what_else_is_asked_for():
    world = BoxWorld(5.0, 4.0, (Box(2.0, 0.5, 3.0, 1.5, 0.9),))
    world.reset(2.3, 3.0, 0.2)
    seen = world.observe(COLOR | {Channel.LABELS, Channel.OBJECTS})
    depth, labelled = world.observe(DEPTH), world.observe(frozenset({Channel.LABELS}))
    np.testing.assert_array_equal(depth.depth, seen.depth)
    np.testing.assert_array_equal(labelled.labels, seen.labels)
    assert depth.rgb.size == labelled.rgb.size == 0
    assert depth.labels is None
    assert labelled.objects is None
