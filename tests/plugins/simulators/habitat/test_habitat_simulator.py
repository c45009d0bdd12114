import math
import os
import sys
from collections.abc import Callable
from types import ModuleType

import numpy as np
import pytest

from deux.contracts import COLOR, DEPTH, Action, Channel, Robot, SceneReference, Simulator
from deux.contracts.scene import SceneArea
from deux.errors import DeuxError
from deux.geometry.camera import Camera
from deux.geometry.poses import camera_pose
from deux.testing.simulators import SimulatorSuite
from deux_plugins.simulators.habitat import HabitatSimulator

CAMERA = Camera(32, 24)
LABELS = frozenset({Channel.LABELS, Channel.OBJECTS})


class TestVersion033(SimulatorSuite):
    """Vectors are magnum's; a scene as of scenes=files."""

    @pytest.fixture(autouse=True)
    def _scene(self, install: Callable[..., ModuleType], make_room: Callable[..., SceneReference]) -> None:
        install(vectors="magnum", version="0.3.3")
        self.scene = make_room()

    def make_simulator(self, camera: Camera) -> Simulator:
        return HabitatSimulator(self.scene, camera, Robot())


class TestVersion025(SimulatorSuite):
    """Vectors are arrays; a Z-up scene with MP3D's annotation, and a navmesh for another robot beside it."""

    @pytest.fixture(autouse=True)
    def _scene(self, install: Callable[..., ModuleType], make_room: Callable[..., SceneReference]) -> None:
        install(vectors="numpy", version="0.2.5", navmesh_loaded=True)
        self.scene = make_room("z", ("_semantic.ply", ".house"))

    def make_simulator(self, camera: Camera) -> Simulator:
        return HabitatSimulator(self.scene, camera, Robot())


@pytest.fixture
def simulator(install: Callable[..., ModuleType], make_room: Callable[..., SceneReference]) -> HabitatSimulator:
    install()
    return HabitatSimulator(make_room(), CAMERA, Robot())


@pytest.mark.parametrize("up", ["y", "z"])
def test_its_camera_is_that_high_above_the_floor_and_sees_the_walls(
    up: str, install: Callable[..., ModuleType], make_room: Callable[..., SceneReference]
) -> None:
    install()
    simulator = HabitatSimulator(make_room(up), Camera(33, 33), Robot())
    assert simulator.floors[0].height == pytest.approx(0.0, abs=1e-3)
    # The room spans x 0 to 6, y 0 to 2.5 and z 0 to 5 of the world.
    simulator.reset(1.0, 2.0, 0.0)
    np.testing.assert_allclose(simulator.pose, camera_pose(1.0, 1.25, 2.0, 0.0), atol=1e-3)
    depth = simulator.observe(DEPTH).depth
    assert depth[16, 16] == pytest.approx(2.0, abs=1e-3)
    # 45 degrees to the left, down and up, at the outermost pixels' centres.
    edge = 16.0 / 16.5
    assert depth[16, 0] == pytest.approx(1.0 / edge, abs=2e-3)
    assert depth[32, 16] == pytest.approx(1.25 / edge, abs=2e-3)
    assert depth[0, 16] == pytest.approx(1.25 / edge, abs=2e-3)
