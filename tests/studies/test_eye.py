import numpy as np
import pytest

from deux.contracts import Robot
from deux.geometry.camera import Camera
from deux.geometry.poses import camera_pose
from deux.simulator.mesh_simulator import MeshSimulator
from deux.simulator.starts import random_starts
from deux.studies.eye import PIXELS, SceneEye
from deux_plugins.scenes.apartments import apartment


@pytest.fixture(scope="module")
def simulator() -> MeshSimulator:
    """What a robot with the eye's number of pixels sees."""
    simulator = MeshSimulator(apartment(200_000), Camera(PIXELS, PIXELS, hfov=80.0, max_depth=6.0), Robot())
    simulator.reset(*random_starts(simulator.free_space(), 1, np.random.default_rng(4))[0])
    return simulator


def test_it_sees_depth_and_labels_as_the_robots_camera_does(simulator):
    eye = SceneEye(simulator.scene, Camera(200, 120, hfov=80.0, max_depth=6.0))
    assert eye.camera == simulator.camera
    look, frame = eye.look(simulator.pose), simulator.observe(labels=True)
    np.testing.assert_array_equal(look.frame.depth, frame.depth)
    np.testing.assert_array_equal(look.frame.labels, np.where(frame.depth > 0.0, frame.labels, -1))


def test_an_object_has_one_label_and_the_building_is_none(simulator):
    eye = SceneEye(simulator.scene, simulator.camera)
    poses = [camera_pose(*simulator.pose[:3, 3], yaw) for yaw in np.arange(0.0, 2.0 * np.pi, 0.5)]
    looks = [eye.look(pose) for pose in poses]
    labels, objects = np.stack([look.frame.labels for look in looks]), np.stack([look.objects for look in looks])
    names = np.array([*eye.label_names, "nothing"])[labels]
    assert not {"wall", "floor", "ceiling"} & set(names[objects >= 0])
    assert {"wall", "floor"} <= set(names[objects < 0])
    shown = np.unique(objects[objects >= 0])
    assert 0 < len(shown) < eye.objects
    assert all(len(set(names[objects == number])) == 1 for number in shown)
