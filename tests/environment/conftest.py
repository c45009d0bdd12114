"""A generated flat that is loaded once."""

from dataclasses import dataclass

import pytest

from deux.contracts import Robot, Scene, SceneReference
from deux.environment.scene_pool import ScenePool
from deux.geometry.camera import Camera
from deux.registry import registry
from deux.simulator.simulation import Simulation
from deux_plugins.scenes.apartments import apartment

CAMERA = Camera(32, 32)


@dataclass(frozen=True)
class LoadedScene(SceneReference):
    """A reference to a scene that is in memory already; it counts how often it is asked for."""

    scene: Scene
    asked: list[str]

    def __hash__(self) -> int:
        return hash(self.name)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, LoadedScene) and other.name == self.name

    @property
    def identity(self) -> str:
        return self.scene.identity

    def load(self) -> Scene:
        self.asked.append(self.name)
        return self.scene


@pytest.fixture(scope="session")
def simulation() -> Simulation:
    """The built-in simulator with a camera of 32 x 32 pixels."""
    return Simulation(CAMERA, Robot(), registry().choose("simulators", {"name": "mesh"}))


@pytest.fixture(scope="session")
def flat() -> Scene:
    return apartment(0)


@pytest.fixture
def references(flat: Scene) -> list[LoadedScene]:
    """Three scenes by name, which are all the same flat."""
    return [LoadedScene(name, flat, []) for name in "abc"]


@pytest.fixture(scope="session")
def flats(flat: Scene, simulation: Simulation) -> tuple[ScenePool, list[LoadedScene]]:
    """A pool with colours, and the scene in it; shared by all tests."""
    return ScenePool(simulation), [LoadedScene("flat", flat, [])]
