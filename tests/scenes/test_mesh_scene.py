from dataclasses import replace

import numpy as np
import pytest
import trimesh

from deux.contracts import Material, SceneMesh
from deux.errors import DeuxError
from deux.log_once import warn_once
from deux.scenes.mesh_scene import has_colors, mesh_scene
from deux_plugins.scenes.files import load_scene

RED = np.full((4, 4, 3), (255, 0, 0), np.uint8)


@pytest.fixture
def room(mesh_of):
    """A closed room of 5 x 2.6 x 4 m, grey."""
    return mesh_of(trimesh.creation.box(bounds=[[0, 0, 0], [5, 2.6, 4]]))


def painted(mesh: SceneMesh, *materials: Material) -> SceneMesh:
    """The mesh with its faces shared out among materials."""
    return replace(
        mesh, materials=materials, face_material=(np.arange(len(mesh.faces)) % len(materials)).astype(np.int32)
    )


def test_floors_are_in_the_world(room):
    scene = mesh_scene("room", replace(room, origin=(448_000.0, 120.0, 5_411_000.0)), "test:1", "room.ply")
    assert [floor.height for floor in scene.floors] == pytest.approx([120.0], abs=1e-6)
    assert (scene.name, scene.identity, scene.load()) == ("room", "test:1", scene)


def test_what_has_colours(room):
    noise = np.random.default_rng(0).integers(0, 256, (4, 4, 3), np.uint8)
    assert not has_colors(room)
    assert not has_colors(painted(room, Material("a", texture=RED), Material("b", texture=RED.copy())))
    assert not has_colors(replace(room, vertex_colors=np.full((len(room.vertices), 3), 7, np.uint8)))
    assert not has_colors(replace(room, materials=(Material("shown"), Material("unused", (1, 2, 3)))))
    assert has_colors(painted(room, Material("a", (1, 2, 3)), Material("b", (3, 2, 1))))
    assert has_colors(painted(room, Material("a", texture=noise)))
    assert has_colors(painted(room, Material("a", texture=RED), Material("b", texture=RED[..., ::-1])))
    assert has_colors(painted(room, Material("a", texture=RED), Material("b")))
    assert has_colors(replace(room, vertex_colors=np.eye(len(room.vertices), 3, dtype=np.uint8)))


def test_what_is_unlikely_is_reported_once(room, caplog):
    for _ in range(2):
        mesh_scene("grey", room, "test:2", "grey.ply")
    assert [record.message for record in caplog.records] == [
        "grey.ply has no colours: models cannot learn depth from its images, which have a single colour."
    ]


@pytest.mark.parametrize(
    ("factor", "said"),
    [(0.001, "0.005 x 0.0026 x 0.004 m large"), (0.3, "1.5 x 0.78 x 1.2 m large"), (20.0, "52 m above the floor")],
)
def test_an_unlikely_size_is_reported_with_the_option(room, caplog, factor, said):
    other = replace(room, vertices=room.vertices * np.float32(factor))
    if factor < 0.1:
        with pytest.raises(
            DeuxError, match=rf"model\.ply: there is no floor .*{said}, it seems .*scenes\.scale=1000 "
        ) as error:
            mesh_scene("model", other, "test:3", "model.ply")
        assert "\n" not in str(error.value)
    else:
        mesh_scene("model", other, "test:3", "model.ply")
        assert said in caplog.text
        assert "scenes.scale=" in caplog.text


def test_what_covers_most_of_the_floor_is_not_its_ceiling(room, mesh_of, slab, caplog):
    stage = slab([0, 0, 0], [3, 0.45, 4])
    scene = mesh_scene(
        "stage", mesh_of(trimesh.creation.box(bounds=[[0, 0, 0], [5, 2.6, 4]]), stage), "test:7", "s.ply"
    )
    assert scene.floor_height == pytest.approx(0.0, abs=1e-6)
    assert "ceiling" not in caplog.text


def test_a_likely_ceiling_is_not_reported(room, caplog):
    mesh_scene("likely", painted(room, Material("a", (1, 2, 3)), Material("b", (3, 2, 1))), "test:5", "likely.ply")
    assert caplog.text == ""


@pytest.mark.parametrize("name", ["small_house.glb", "lounge.ply"])
def test_nothing_is_reported_of_real_scenes(shared_data, name, caplog):
    warn_once.cache_clear()  # an earlier test of this process may have logged it
    assert load_scene(shared_data("scenes") / name).floors[0].height == pytest.approx(0.0, abs=0.05)
    assert caplog.text == ""
