import copy
import math
from dataclasses import replace

import numpy as np
import pytest

from deux.contracts import Action, Robot, Scene
from deux.errors import DeuxError
from deux.geometry.camera import Camera
from deux.geometry.poses import camera_pose, yaw_of
from deux.simulator.mesh_simulator import MeshSimulator

CAMERA = Camera(32, 32)


def test_it_walks_turns_and_sees(box: Scene) -> None:
    simulator = MeshSimulator(box, CAMERA, Robot())
    simulator.reset(2.0, 2.0, 0.0)
    np.testing.assert_allclose(simulator.pose, camera_pose(2.0, 1.25, 2.0, 0.0))
    assert simulator.step(Action.FORWARD) is False
    np.testing.assert_allclose(simulator.pose, camera_pose(2.0, 1.25, 1.75, 0.0), atol=1e-6)
    assert simulator.step(Action.LEFT) is False
    assert yaw_of(simulator.pose) == pytest.approx(math.radians(10))
    simulator.step(Action.FORWARD)
    moved = simulator.pose[:3, 3] - (2.0, 1.25, 1.75)
    np.testing.assert_allclose(moved, [-0.0434120, 0.0, -0.2462019], atol=1e-6)
    simulator.step(Action.RIGHT)
    assert simulator.step(Action.STOP) is False
    assert yaw_of(simulator.pose) == pytest.approx(0.0, abs=1e-12)

    frame = simulator.observe()
    assert frame.labels is None
    np.testing.assert_array_equal(frame.pose, simulator.pose)
    np.testing.assert_allclose(frame.depth[16, 16], frame.pose[2, 3], atol=1e-5)
    labelled = simulator.observe(labels=True)
    assert labelled.labels is not None
    assert simulator.label_names[labelled.labels[16, 16]] == "quad 4"  # low end of z


def test_depth_alone_is_that_of_the_frame(box: Scene) -> None:
    simulator = MeshSimulator(box, CAMERA, Robot())
    simulator.reset(2.0, 2.0, 0.3)
    for action in (Action.FORWARD, Action.LEFT, Action.FORWARD):
        simulator.step(action)
        seen = simulator.observe(labels=True)
        np.testing.assert_array_equal(simulator.depth(), seen.depth)
        for alone, whole in zip(simulator.labelled_depth(), (seen.depth, seen.labels), strict=True):
            np.testing.assert_array_equal(alone, whole)


def test_what_is_prepared_is_shared_by_copies_that_move_on_their_own(box: Scene) -> None:
    simulator = MeshSimulator(box, CAMERA, Robot())
    simulator.prepare()
    first, second = copy.copy(simulator), copy.copy(simulator)
    assert first._renderer is second._renderer is simulator._renderer
    assert first.free_space() is second.free_space()
    first.reset(2.0, 2.0, 0.0)
    second.reset(1.0, 1.0, 0.0)
    first.step(Action.FORWARD)
    np.testing.assert_allclose(second.pose, camera_pose(1.0, 1.25, 1.0, 0.0))
    with pytest.raises(DeuxError, match="call reset"):
        simulator.depth()


def test_turns_add_up_exactly(box: Scene) -> None:
    simulator = MeshSimulator(box, CAMERA, Robot())
    simulator.reset(2.0, 1.5, 0.4)
    start = simulator.pose
    for _ in range(36):
        simulator.step(Action.LEFT)
    np.testing.assert_allclose(simulator.pose, start, atol=1e-12)


def test_it_stops_at_the_wall_a_radius_away(box: Scene) -> None:
    simulator = MeshSimulator(box, CAMERA, Robot())
    simulator.reset(2.0, 1.5, 0.0)
    collisions = [simulator.step(Action.FORWARD) for _ in range(12)]
    assert collisions == sorted(collisions)
    assert collisions[-1]
    assert 0.1 <= simulator.pose[2, 3] <= 0.16  # the radius, up to a cell


def test_the_camera_is_above_the_scenes_own_floor(box: Scene) -> None:
    lifted = replace(box.mesh, vertices=box.mesh.vertices + np.float32([0.0, 7.0, 0.0]))
    simulator = MeshSimulator(replace(box, mesh=lifted, floor_height=7.0), CAMERA, Robot(camera_height=0.8))
    simulator.reset(2.0, 1.5, 0.0)
    assert simulator.pose[1, 3] == pytest.approx(7.8)
    assert simulator.free_space() is simulator.free_space()
    assert simulator.free_space().floor_height == 7.0


def test_it_cannot_be_put_into_a_wall_or_moved_before_it_is_put(box: Scene) -> None:
    simulator = MeshSimulator(box, CAMERA, Robot())
    with pytest.raises(DeuxError, match="not in quads yet: call reset"):
        simulator.step(Action.FORWARD)
    with pytest.raises(DeuxError, match=r"cannot stand at x=0\.020, z=1\.500 in quads"):
        simulator.reset(0.02, 1.5, 0.0)
    with pytest.raises(DeuxError, match="cannot stand at x=50"):
        simulator.reset(50.0, 1.5, 0.0)


def test_a_wrong_renderer_is_an_error(box: Scene) -> None:
    simulator = MeshSimulator(box, CAMERA, Robot(), renderer="pyrnder")
    simulator.reset(2.0, 1.5, 0.0)
    with pytest.raises(DeuxError, match="did you mean pyrender"):
        simulator.observe()
