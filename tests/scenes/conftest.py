"""Meshes that several tests put together."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import trimesh

from deux.contracts import Material, SceneMesh


@pytest.fixture(scope="session")
def mesh_of() -> Callable[..., SceneMesh]:
    """A function from trimesh's meshes to one grey scene mesh."""

    def join(*parts: trimesh.Trimesh) -> SceneMesh:
        joined = trimesh.util.concatenate(parts)
        count = len(joined.faces)
        return SceneMesh(
            vertices=np.asarray(joined.vertices, np.float32),
            faces=np.asarray(joined.faces, np.int32),
            uv=np.zeros((count, 3, 2), np.float32),
            face_material=np.zeros(count, np.int32),
            materials=(Material("grey"),),
            face_label=np.full(count, -1, np.int32),
        )

    return join


@pytest.fixture(scope="session")
def slab() -> Callable[..., trimesh.Trimesh]:
    """A function from two opposite corners to the box between them."""
    return lambda low, high: trimesh.creation.box(bounds=[low, high])


@pytest.fixture(scope="session")
def sheet() -> Callable[..., trimesh.Trimesh]:
    """A function from four corners, in order, to the rectangle of no thickness between them."""
    return lambda *corners: trimesh.Trimesh(corners, [[0, 1, 2], [0, 2, 3]], process=False)


@pytest.fixture(scope="session")
def house(slab: Callable[..., trimesh.Trimesh]) -> Callable[..., list[trimesh.Trimesh]]:
    """house(y, door, floor): an 8 m x 6 m storey at height y, walls of 0.2 m, 2.6 m high, under a slab of 0.3 m.

    The floor slab is 0.2 m thick; in the wall at z = 0 a door of 1 m x 2.1 m begins at x = 3 if it is asked for.
    """

    def build(y: float = 0.0, door: bool = False, floor: bool = True) -> list[trimesh.Trimesh]:
        front = [slab([0, y, 0], [3, y + 2.6, 0.2]), slab([4, y, 0], [8, y + 2.6, 0.2])]
        front.append(slab([3, y + 2.1, 0], [4, y + 2.6, 0.2]) if door else slab([3, y, 0], [4, y + 2.6, 0.2]))
        walls = [
            slab([0, y, 5.8], [8, y + 2.6, 6]),
            slab([0, y, 0], [0.2, y + 2.6, 6]),
            slab([7.8, y, 0], [8, y + 2.6, 6]),
        ]
        level = [slab([0, y - 0.2, 0], [8, y, 6])] if floor else []
        return [*level, *front, *walls, slab([0, y + 2.6, 0], [8, y + 2.9, 6])]

    return build


@pytest.fixture(scope="session")
def two_storeys(
    slab: Callable[..., trimesh.Trimesh], house: Callable[..., list[trimesh.Trimesh]]
) -> Callable[..., Any]:
    """two_storeys(steps, tread): floors at 0 and 2.9 m, joined by a straight flight of steps, 1 m wide, along x.

    The flight begins at x = 0.5 and z = 4.7 to 5.7; above it the slab between the storeys is open.
    """

    def build(steps: int = 18, tread: float = 0.25) -> list[trimesh.Trimesh]:
        rise, end = 2.9 / steps, 0.5 + steps * tread
        flight = [
            slab([0.5 + tread * k, 0, 4.7], [0.5 + tread * (k + 1), rise * (k + 1), 5.7]) for k in range(steps - 1)
        ]
        opened = [
            slab([0, 2.6, 0], [8, 2.9, 4.7]),
            slab([end - tread, 2.6, 4.7], [8, 2.9, 6]),
            slab([0, 2.6, 5.7], [8, 2.9, 6]),
        ]
        return [*house()[:-1], *flight, *opened, *house(2.9, floor=False)]

    return build
