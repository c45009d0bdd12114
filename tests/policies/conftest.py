"""A room of boxes that stands for scenes, so that training takes seconds."""

import copy
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest

from deux.contracts import Action, Reward, Robot
from deux.environment.egocentric import Crops
from deux.environment.exploration_env import ExplorationEnv
from deux.geometry.camera import Camera
from deux.geometry.grid import FreeSpace
from deux.testing.box_world import Box, BoxWorld

CAMERA = Camera(16, 16)
CROPS = Crops(pixels=16)


class Room(BoxWorld):
    """A room with a free floor that is computed once."""

    def __init__(self) -> None:
        super().__init__(5.0, 4.0, (Box(2.4, 1.5, 2.6, 4.0),), CAMERA)
        self.reset(1.0, 1.0, 0.0)  # its middle lies in the box
        self.floor = super().free_space()

    def free_space(self, floor: int = 0) -> FreeSpace:
        return self.floor


class Rooms:
    """Stands for a `ScenePool`."""

    simulation = SimpleNamespace(camera=CAMERA, robot=Robot())
    colors = True

    def __init__(self) -> None:
        self.room = Room()

    def simulator(self, reference: object) -> Room:
        return copy.copy(self.room)


class LikesLeft(Reward):
    """1 for each turn to the left, and a number that it learns: the sum of all it gave."""

    def __init__(self) -> None:
        self.given = np.zeros(1)

    def reset(self, episode):
        pass

    def __call__(self, experience):
        value = float(experience.action == Action.LEFT)
        self.given += value
        return value

    def state(self):
        return {"given": self.given.copy()}

    def load_state(self, state):
        self.given = np.array(state["given"])


@pytest.fixture(scope="session")
def rooms():
    return Rooms()


@pytest.fixture
def make_environment(rooms):
    """A function from a reward, by name or a class, to a function that makes an environment with it."""

    def make(reward="coverage", steps=32):
        return ExplorationEnv(
            [rooms.room.scene], reward if isinstance(reward, str) else reward(), steps=steps, crops=CROPS, pool=rooms
        )

    return lambda *arguments, **options: partial(make, *arguments, **options)


@pytest.fixture
def likes_left():
    return LikesLeft
