from collections.abc import Iterator

import numpy as np
import pytest

from deux.contracts import DEPTH, Robot, SceneReference, Simulator
from deux.errors import DeuxError
from deux.geometry.camera import Camera
from deux.registry import registry
from deux.testing.box_world import BoxScene, BoxWorld
from deux.testing.simulators import SimulatorSuite, assert_same
from deux_example.box_rooms import BoxRooms
from deux_example.noisy_depth import NoisyDepth

ROOM = BoxScene("room", 4.0, 8.0, ())
TELE = Camera(120, 100, hfov=10.0)
"""Sees nothing but the wall."""


class BareRoom(BoxWorld):
    """The box world as a plugin."""

    def __init__(self, scene: SceneReference, camera: Camera, robot: Robot, colors: bool = True) -> None:
        super().__init__(4.0, 8.0, (), camera, robot)


class TestNoisyDepth(SimulatorSuite):
    def make_simulator(self, camera: Camera) -> Simulator:
        return NoisyDepth(BoxRooms(train=1).splits().train[0], camera, Robot())


@pytest.fixture
def bare_room() -> Iterator[str]:
    """The name under which the bare room is registered."""
    registry().register("simulators", "bare_room", BareRoom)
    yield "bare_room"
    registry().unregister("simulators", "bare_room")


@pytest.mark.parametrize("distance", [1.0, 3.0, 6.0])
def test_a_walls_depth_spreads_with_the_square_of_its_distance(bare_room: str, distance: float) -> None:
    simulator = NoisyDepth(ROOM, TELE, Robot(), simulator=bare_room, factor=0.003, missing=0.0)
    simulator.reset(2.0, distance, 0.0)
    error = simulator.observe(DEPTH).depth - distance
    sigma = 0.003 * distance**2
    assert error.std() == pytest.approx(sigma, rel=0.03)
    assert abs(error.mean()) < 4.0 * sigma / error.size**0.5
    # Neighbouring pixels err independently: the mean of both spreads by sigma / sqrt(2).
    assert ((error[:, ::2] + error[:, 1::2]) / 2).std() == pytest.approx(sigma / 2**0.5, rel=0.05)


def test_pixels_are_missing_at_random_and_others_at_each_pose(bare_room: str) -> None:
    simulator = NoisyDepth(ROOM, TELE, Robot(), simulator=bare_room, factor=0.0, missing=0.2)
    missing = []
    for distance in (3.0, 3.001):
        simulator.reset(2.0, distance, 0.0)
        depth = simulator.observe(DEPTH).depth
        np.testing.assert_allclose(depth[depth > 0.0], distance, rtol=1e-6)
        missing.append(depth == 0.0)
    assert np.mean(missing) == pytest.approx(0.2, abs=0.02)
    assert (missing[0] & missing[1]).mean() == pytest.approx(0.04, abs=0.01)


def test_a_wall_at_the_end_of_the_range_is_measured_in_half_of_the_pixels(bare_room: str) -> None:
    camera = Camera(120, 100, hfov=10.0, max_depth=3.0)
    simulator = NoisyDepth(ROOM, camera, Robot(), simulator=bare_room, missing=0.0)
    simulator.reset(2.0, 3.0, 0.0)
    depth = simulator.observe(DEPTH).depth
    assert (depth > 0.0).mean() == pytest.approx(0.5, abs=0.02)
    assert depth.max() <= 3.0


def test_without_noise_it_is_the_exact_simulator(bare_room: str) -> None:
    simulator = NoisyDepth(ROOM, TELE, Robot(), simulator=bare_room, factor=0.0, missing=0.0)
    exact = BareRoom(ROOM, TELE, Robot())
    for robot in (simulator, exact):
        robot.reset(1.5, 4.0, 0.4)
    assert_same(simulator.observe(), exact.observe())


def test_noise_on_noise_is_refused() -> None:
    registry().register("simulators", "noisy", NoisyDepth)
    try:
        with pytest.raises(DeuxError, match="exact simulator"):
            NoisyDepth(ROOM, TELE, Robot(), simulator="noisy")
    finally:
        registry().unregister("simulators", "noisy")
