"""A scene whose mesh or floors break the contract is an error that names the scene, its reference and the array."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

from deux.contracts import Floor, Material, Scene, SceneMesh, SceneReference
from deux.errors import DeuxError
from deux.geometry.camera import Camera
from deux.geometry.robot import Robot
from deux.scenes.loaded_scene import loaded_scene
from deux.simulator.mesh_simulator import MeshSimulator

MESH = SceneMesh(
    vertices=3 * np.array([[0, 0, 0], [1, 0, 0], [1, 0, 1], [0, 0, 1]], np.float32),
    faces=np.array([[0, 1, 2], [0, 2, 3]], np.int32),
    uv=np.zeros((2, 3, 2), np.float32),
    face_material=np.array([0, 1], np.int32),
    materials=(Material("grey"), Material("wood", texture=np.zeros((4, 4, 3), np.uint8))),
    face_label=np.array([-1, 0], np.int32),
    label_names=("floor",),
    vertex_colors=np.zeros((4, 3), np.uint8),
    face_object=np.array([-1, 7], np.int32),
)
SQUARE = Scene("square", MESH, (Floor(0.0, 9.0),), "square")


@dataclass(frozen=True)
class Given(SceneReference):
    """A reference to a scene, or to whatever else `load` is to return."""

    scene: Any

    @property
    def identity(self) -> str:
        return "given"

    def load(self) -> Scene:
        return self.scene  # type: ignore[no-any-return]


def with_value(array: np.ndarray, value: float) -> np.ndarray:
    """A copy with another last element."""
    array = array.copy()
    array.flat[-1] = value
    return array


def test_a_valid_scene_is_returned_as_it_is() -> None:
    assert loaded_scene(Given("square", SQUARE)) is SQUARE
    assert loaded_scene(SQUARE) is SQUARE


@pytest.mark.parametrize(
    ("changes", "given"),
    [
        ({"vertices": MESH.vertices.astype(float)}, "array `vertices` is ndarray of 4 x 3, float64: .* 4 x 3, float32"),
        ({"vertices": MESH.vertices.tolist()}, "array `vertices` is a value of the type list"),
        ({"vertices": with_value(MESH.vertices, np.nan)}, "array `vertices` is not finite"),
        ({"faces": MESH.faces.astype(np.int64)}, "array `faces` is ndarray of 2 x 3, int64"),
        ({"faces": with_value(MESH.faces, 4)}, "array `faces` goes from 0 to 4: it must be 0 to 3, an index into vert"),
        ({"faces": with_value(MESH.faces, -1)}, "array `faces` goes from -1 to 2"),
        ({"uv": MESH.uv[:, 0]}, "array `uv` is ndarray of 2 x 2, float32: it must be an ndarray of 2 x 3 x 2, float32"),
        ({"uv": with_value(MESH.uv, np.inf)}, "array `uv` is not finite"),
        ({"face_material": MESH.face_material[:1]}, "array `face_material` is ndarray of 1, int32: .* for its 2 faces"),
        ({"face_material": with_value(MESH.face_material, 2)}, "array `face_material` goes from 0 to 2"),
        ({"materials": ()}, "array `face_material` goes from 0 to 1: it must be a mesh with materials"),
        ({"materials": ("grey", "wood")}, "materials hold a value of the type str"),
        (
            {"materials": (Material("a"), Material("b", texture=np.zeros((4, 4, 3))))},
            "material b has a texture that is",
        ),
        ({"face_label": with_value(MESH.face_label, 1)}, "array `face_label` goes from -1 to 1: it must be -1 to 0"),
        ({"face_object": with_value(MESH.face_object, -2)}, "array `face_object` goes from -2 to -1"),
        ({"vertex_colors": np.zeros((3, 3), np.uint8)}, "array `vertex_colors` is ndarray of 3 x 3, uint8"),
        (
            {"faces": MESH.faces[:0], "uv": MESH.uv[:0], "face_material": MESH.face_material[:0]}
            | {"face_label": MESH.face_label[:0], "face_object": None},
            "array `faces` is empty: it must be a mesh with faces",
        ),
    ],
)
def test_a_mesh_that_breaks_the_contract_is_refused(changes: dict[str, Any], given: str) -> None:
    """Compiled renderers do not check bounds: without this, a wrong index ends the process."""
    scene = replace(SQUARE, mesh=replace(MESH, **changes))
    named = rf"^the `load` of the scene square \(Given of .*test_loaded_scene\) gives a mesh whose {given}"
    with pytest.raises(DeuxError, match=named):
        MeshSimulator(Given("square", scene), Camera(16, 16), Robot())


@pytest.mark.parametrize(
    ("scene", "given"),
    [
        (None, r"None: it must be a deux\.contracts\.Scene\."),
        (MESH, "a value of the type SceneMesh"),
        (replace(SQUARE, mesh=None), "a mesh that is None"),  # type: ignore[arg-type]
        (replace(SQUARE, floors=()), "no floor"),
        (replace(SQUARE, floors=[Floor(0.0, 9.0)]), "floors that are a value of the type list"),  # type: ignore[arg-type]
        (replace(SQUARE, floors=(Floor(np.nan, 9.0),)), "a floor without a finite height"),
    ],
)
def test_anything_but_a_scene_with_floors_is_refused(scene: object, given: str) -> None:
    with pytest.raises(DeuxError, match=rf"^the `load` of the scene square \(.*\) gives {given}"):
        loaded_scene(Given("square", scene))
