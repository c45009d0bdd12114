"""Meshes that several tests put together."""

from collections.abc import Callable

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
