"""Scenes and views that several tests look at; makes the helper module `opengl_suite` importable by its name."""

import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from deux.contracts import Floor, Material, Robot, Scene, SceneMesh, SceneReference
from deux.geometry.poses import camera_pose
from deux.scenes.free_space import free_space
from deux.simulator.starts import random_starts
from deux_plugins.scenes.apartments import apartment

sys.path.insert(0, str(Path(__file__).parent))


def quads(corners: np.ndarray, materials: tuple[Material, ...], vertex_colors: np.ndarray | None = None) -> Scene:
    count = len(corners)
    face = np.array([[0, 1, 2], [0, 2, 3]])
    corner_uv = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], dtype=np.float32)
    mesh = SceneMesh(
        vertices=corners.reshape(-1, 3).astype(np.float32),
        faces=(face[None] + 4 * np.arange(count)[:, None, None]).reshape(-1, 3).astype(np.int32),
        uv=np.tile(corner_uv[face], (count, 1, 1)),
        face_material=np.repeat(np.arange(count), 2).astype(np.int32),
        materials=materials,
        face_label=np.repeat(np.arange(count), 2).astype(np.int32),
        label_names=tuple(f"quad {i}" for i in range(count)),
        vertex_colors=vertex_colors,
    )
    return Scene("quads", mesh, (Floor(0.0, 12.0),), "test:quads")


@dataclass(frozen=True)
class LoadedScene(SceneReference):
    """A reference to a scene that is in memory already."""

    scene: Scene

    @property
    def identity(self) -> str:
        return self.scene.identity

    def load(self) -> Scene:
        return self.scene


@pytest.fixture(scope="session")
def refer() -> Callable[[Scene], LoadedScene]:
    """A function from a scene in memory to a reference to it."""
    return lambda scene: LoadedScene(scene.name, scene)


@pytest.fixture(scope="session")
def make_quads() -> Callable[..., Scene]:
    """A function from Q x 4 x 3 corners (from the texture's bottom left round to its top left), Q materials and
    maybe 4Q x 3 vertex colours to a scene; quad i has material i and label i."""
    return quads


@pytest.fixture(scope="session")
def box() -> Scene:
    """A closed room of 4 x 2.5 x 3 m at the origin, each side of one colour; side 2 axis + (0 low, 1 high)."""
    size = np.array([4.0, 2.5, 3.0])
    sides = []
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        for end in (0.0, size[axis]):
            side = np.zeros((4, 3))
            side[:, axis] = end
            side[[1, 2], u] = size[u]
            side[[2, 3], v] = size[v]
            sides.append(side)
    colors = [(250, 10, 10), (10, 250, 10), (10, 10, 250), (250, 250, 10), (10, 250, 250), (250, 10, 250)]
    return quads(np.array(sides), tuple(Material(str(color), color) for color in colors))


@pytest.fixture(scope="session")
def flat() -> Scene:
    return apartment(0)


@pytest.fixture(scope="session")
def flat_poses(flat: Scene) -> list[np.ndarray]:
    """Camera poses spread over the generated flat."""
    floor = free_space(flat.mesh, flat.floor_height, Robot())
    starts = random_starts(floor, 6, np.random.default_rng(0))
    return [camera_pose(x, flat.floor_height + 1.25, z, yaw) for x, z, yaw in starts]


class HabitatView(NamedTuple):
    """What Habitat-Sim rendered of small_house: 4 x 4 OpenCV camera-to-world pose, H x W x 3 uint8, H x W metres."""

    pose: np.ndarray
    rgb: np.ndarray
    depth: np.ndarray


@pytest.fixture(scope="session")
def habitat_views(shared_data: Callable[[str], Path]) -> list[HabitatView]:
    views = []
    for path in sorted(shared_data("habitat").glob("pose_*.npz")):
        with np.load(path) as data:
            opengl = np.linalg.inv(data["camera_matrix_world_to_cam"].astype(np.float64))
            views.append(HabitatView(opengl @ np.diag([1.0, -1.0, -1.0, 1.0]), data["rgb"], data["depth"]))
    return views
