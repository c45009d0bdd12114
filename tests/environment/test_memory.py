import numpy as np

from deux.contracts import Action
from deux.environment.egocentric import Crops
from deux.environment.memory import MOVES, ExplorationMemory
from deux.testing.box_world import Box, BoxWorld

FREE, OCCUPIED, UNKNOWN, VISITED = range(4)


def remember(world, crops=None):
    memory = ExplorationMemory(world.camera, world.robot, crops or Crops(pixels=40))
    memory.see(world.observe().depth, world.pose, False)
    return memory


def go(memory, world, action):
    memory.acted(action)
    collided = world.step(action)
    memory.see(world.observe().depth, world.pose, collided)
    return collided


def test_it_never_stops():
    assert MOVES == (Action.FORWARD, Action.LEFT, Action.RIGHT)
    assert [int(move) for move in MOVES] == [0, 1, 2]


def test_a_room_is_seen_from_within():
    """A wall 1.5 m ahead of the robot, and a box on its right."""
    world = BoxWorld(6.0, 6.0, (Box(4.0, 2.0, 4.5, 3.0),))
    world.reset(3.0, 1.5 + 0.01, 0.0)
    memory = remember(world)
    for _ in range(36):
        go(memory, world, Action.LEFT)
    near = memory.view()["near"]  # 40 pixels of 0.1 m, the robot between rows 19 and 20
    assert (near[OCCUPIED, 4:6, 10:30].max(axis=0) > 100).all(), "the wall, 1.5 m up"
    assert (near[UNKNOWN, :3, 10:30] == 255).all(), "nothing is known beyond it"
    assert near[FREE, 10:30, 10:28].min() > 100, "the floor around the robot"
    assert near[OCCUPIED, 25:33, 29:31].max(axis=1).min() > 50, "the box's left side, 1 m to the right"


def test_near_and_far_show_the_same_place_at_two_scales():
    world = BoxWorld(6.0, 6.0)
    world.reset(3.0, 3.0, 0.4)
    view = remember(world, Crops(near=4.0, far=8.0, pixels=32)).view()
    middle = view["far"][:, 8:24, 8:24]
    coarse = view["near"].reshape(4, 16, 2, 16, 2).mean(axis=(2, 4))
    assert np.abs(middle - coarse).mean() < 4.0, "grey levels"


def test_the_body_tells_the_last_move_and_whether_it_was_cut_short():
    world = BoxWorld(3.0, 3.0)
    memory = remember(world)
    assert memory.view()["body"].tolist() == [0.0, 0.0, 0.0, 0.0]
    for action, expected in ((Action.FORWARD, 0), (Action.LEFT, 1), (Action.RIGHT, 2)):
        assert not go(memory, world, action)
        assert memory.view()["body"].tolist() == [*np.eye(3)[expected], 0.0]
    world.reset(1.5, 0.12, 0.0)
    assert go(memory, world, Action.FORWARD)
    assert memory.view()["body"].tolist() == [1.0, 0.0, 0.0, 1.0]


def test_where_it_has_been_lies_behind_it():
    world = BoxWorld(6.0, 6.0)
    world.reset(3.03, 4.04, 0.0)
    memory = remember(world)
    for _ in range(4):
        go(memory, world, Action.FORWARD)
    visited = memory.view()["near"][VISITED] > 0
    rows, columns = np.nonzero(visited)
    assert rows.min() >= 18, "nothing ahead"
    assert 29 <= rows.max() <= 31, "1 m"
    assert columns.min() >= 18
    assert columns.max() <= 21, "as wide as the robot"
    assert visited[19:30, 19:21].any(axis=1).sum() >= 10, "a trail, but for gaps between two steps"


def test_an_obstacle_that_no_camera_sees_is_remembered_once_it_is_met():
    """The camera sees an empty hall; the robot is held back by something, then by nothing."""
    world = BoxWorld(6.0, 6.0)
    for moved, expected in ((0.0, True), (0.03, True), (0.2, False)):
        world.reset(3.0, 3.0, 0.0)
        memory = remember(world)
        memory.acted(Action.FORWARD)
        world.reset(3.0, 3.0 - moved, 0.0)
        memory.see(world.observe().depth, world.pose, True)
        ahead = memory.view()["near"][OCCUPIED, 14:20, 18:22]
        assert (ahead.max() > 0) == expected
    memory.acted(Action.LEFT)
    memory.see(world.observe().depth, world.pose, True)
    assert memory.view()["near"][OCCUPIED, 14:20, 18:22].max() == 0, "a turn meets nothing"


def test_views_stay_as_they_are():
    world = BoxWorld(6.0, 6.0)
    memory = remember(world)
    view = memory.view()
    before = {name: part.copy() for name, part in view.items()}
    for _ in range(3):
        go(memory, world, Action.FORWARD)
    assert all(np.array_equal(view[name], before[name]) for name in view)
