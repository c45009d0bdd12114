"""What every generated flat promises to simulators and learners."""

import hashlib
import subprocess
import sys

import numpy as np
import pytest
from generated_scenes import STRUCTURE, Rays, digest, rays_from_the_floor, seen_from_behind, sharing_a_plane

from deux.contracts import Robot, Scene
from deux.errors import DeuxError
from deux.geometry.grid import FreeSpace
from deux.scenes.free_space import free_space
from deux.scenes.ray_caster import Hits, RayCaster
from deux_plugins.scenes.apartments import APARTMENT_VERSION, LABEL_NAMES, apartment
from deux_plugins.scenes.apartments.layout import make_floor_plan
from deux_plugins.scenes.parts.draws import Draws

DIGEST_OF_SEED_0 = "2b4b918cede33889aad1c079ff972ca25e00661eda32695d5b818afcc97af267"
"""Of version 1. If it changes, either something became machine-dependent or APARTMENT_VERSION has to be raised."""


@pytest.fixture(scope="module")
def caster(flat: Scene) -> RayCaster:
    return RayCaster(flat.mesh)


@pytest.fixture(scope="module")
def space(flat: Scene, caster: RayCaster) -> FreeSpace:
    return free_space(flat.mesh, flat.floor_height, Robot(), caster=caster)


@pytest.fixture(scope="module")
def rays(space: FreeSpace) -> Rays:
    return rays_from_the_floor(space)


@pytest.fixture(scope="module")
def hits(caster: RayCaster, rays: Rays) -> Hits:
    return caster.cast(*rays)


def test_a_seed_always_gives_the_same_bytes(flats: dict[int, Scene]):
    assert APARTMENT_VERSION == 1
    assert digest(flats[0]) == DIGEST_OF_SEED_0


def test_another_process_gives_the_same_bytes(flats: dict[int, Scene]):
    program = (
        "import hashlib; from deux_plugins.scenes.apartments import apartment; "
        "print(hashlib.sha256(apartment(1).mesh.vertices.tobytes()).hexdigest())"
    )
    other = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert other.stdout.strip() == hashlib.sha256(flats[1].mesh.vertices.tobytes()).hexdigest()


def test_different_seeds_give_different_flats(flats: dict[int, Scene]):
    assert len({digest(scene) for scene in flats.values()}) == len(flats)
    assert len({scene.mesh.bounds.tobytes() for scene in flats.values()}) == len(flats)
    textures = [{m.texture.tobytes() for m in scene.mesh.materials} for scene in flats.values()]
    assert not set.intersection(*textures)


def test_name_and_identity():
    scene = apartment(17)
    assert scene.name == "apartment-00017"
    assert scene.identity == f"apartment:{APARTMENT_VERSION}:17"
    assert scene.floor_height == 0.0


def test_a_negative_seed_is_refused():
    with pytest.raises(DeuxError, match="-3"):
        apartment(-3)


def test_arrays_have_the_declared_types_and_ranges(flat: Scene):
    mesh = flat.mesh
    assert (mesh.vertices.dtype, mesh.uv.dtype, mesh.vertex_colors.dtype) == (np.float32, np.float32, np.uint8)
    assert {array.dtype for array in (mesh.faces, mesh.face_material, mesh.face_label)} == {np.dtype(np.int32)}
    assert 0 <= mesh.faces.min() <= mesh.faces.max() < len(mesh.vertices) == len(mesh.vertex_colors)
    assert 0 <= mesh.face_material.min() <= mesh.face_material.max() < len(mesh.materials)
    assert 0 <= mesh.face_label.min() <= mesh.face_label.max() < len(LABEL_NAMES)
    assert mesh.label_names == LABEL_NAMES
    assert np.isfinite(mesh.uv).all()
    assert mesh.bounds[0, 1] == 0.0


def test_size_is_modest(flat: Scene):
    assert 3_000 <= len(flat.mesh.faces) <= 15_000
    textures = {id(material.texture): material.texture.nbytes for material in flat.mesh.materials}
    assert sum(textures.values()) < 20e6


def test_no_triangle_is_degenerate(flat: Scene):
    corners = flat.mesh.triangles.astype(np.float64)
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert np.linalg.norm(cross, axis=1).min() / 2 > 1e-5
    edges = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
    assert edges.min() > 9e-4


def test_furniture_is_varied_and_labelled(flats: dict[int, Scene]):
    kinds = [{LABEL_NAMES[label] for label in np.unique(scene.mesh.face_label)} - STRUCTURE for scene in flats.values()]
    assert min(len(kind) for kind in kinds) >= 12
    assert len(set.union(*kinds)) >= 25
    assert all({"bed", "sofa", "toilet", "counter", "refrigerator", "picture", "lamp"} <= kind for kind in kinds)


def test_the_robot_sees_geometry_in_every_direction(hits: Hits):
    assert (hits.face >= 0).all()
    assert hits.distance.min() > 0.1
    assert (hits.distance < 10.0).mean() > 0.995


def test_visible_faces_look_at_the_robot(flat: Scene, rays: Rays, hits: Hits):
    assert seen_from_behind(flat, rays, hits) < 5e-4


def test_no_two_visible_faces_share_a_plane(flat: Scene, caster: RayCaster, rays: Rays, hits: Hits):
    assert sharing_a_plane(flat, caster, rays, hits) < 2e-4


@pytest.mark.parametrize("radius", [0.1, 0.25])
def test_every_room_can_be_reached(flats: dict[int, Scene], radius: float):
    for seed, scene in flats.items():
        space = free_space(scene.mesh, 0.0, Robot(radius=radius))
        for room in make_floor_plan(Draws(seed, "floor plan")).rooms:
            low, high = space.frame.cell(room.x0, room.z0), space.frame.cell(room.x1, room.z1)
            assert space.free[low[0] : high[0], low[1] : high[1]].mean() > 0.05, (seed, room.kind)


def test_rugs_can_be_rolled_over(flat: Scene):
    rug = flat.mesh.triangles[flat.mesh.face_label == LABEL_NAMES.index("rug")]
    assert rug[..., 1].max() <= 0.015


def test_light_varies_but_never_hides_the_texture(flat: Scene):
    brightness = flat.mesh.vertex_colors.mean(axis=1)
    assert brightness.min() > 100
    assert brightness.std() > 8
