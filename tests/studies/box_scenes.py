"""Rooms with boxes as scenes of a simulation, and a depth model that is asked by the studies."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import torch
from torch import Tensor

from deux.contracts import Robot, SceneReference
from deux.geometry.camera import Camera
from deux.registry import PluginChoice, registry
from deux.simulator.simulation import Simulation
from deux.testing.box_world import Box, BoxWorld

CAMERA = Camera(40, 32)


@dataclass(frozen=True)
class BoxRoom(SceneReference):
    """A room of some length, with a low box in it."""

    length: float

    @property
    def identity(self) -> str:
        return f"box room:{self.length}"


SCENES = (BoxRoom("short", 4.0), BoxRoom("long", 7.0))


class BoxRoomSimulator(BoxWorld):
    loaded: list[str] = []  # noqa: RUF012

    def __init__(self, scene: BoxRoom, camera: Camera, robot: Robot, colors: bool) -> None:
        self.loaded.append(scene.name)
        super().__init__(4.0, scene.length, (Box(0.5, 0.5, 1.0, 1.0, 0.8),), camera, robot)


@contextmanager
def box_simulation() -> Iterator[Simulation]:
    """A simulation whose scenes are `BoxRoom`s."""
    BoxRoomSimulator.loaded.clear()
    registry().register("simulators", "box_rooms", BoxRoomSimulator)
    try:
        yield Simulation(CAMERA, Robot(), PluginChoice("simulators", "box_rooms", {}))
    finally:
        registry().unregister("simulators", "box_rooms")


class FarModel:
    """Predicts 3 m, less where the image is bright; counts the frames that it is asked for."""

    def __init__(self) -> None:
        self.frames: list[Tensor] = []

    def __call__(self, image: Tensor, sparse_depth: Tensor, intrinsics: Tensor) -> Tensor:
        self.frames += [*image]
        return 3.0 - image.mean(dim=1, keepdim=True)

    def asked_twice(self) -> int:
        """Number of frames that were predicted before."""
        return len(self.frames) - len(torch.stack(self.frames).flatten(1).unique(dim=0))


def explorer(name: str, **options: object) -> PluginChoice:
    return registry().choose("explorers", {"name": name, **options})


def measure(name: str) -> PluginChoice:
    return registry().choose("uncertainties", {"name": name})
