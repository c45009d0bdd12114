"""What every generated house promises to simulators and learners."""

import hashlib
import subprocess
import sys

import numpy as np
import pytest
from generated_scenes import STRUCTURE, Rays, digest, rays_from_the_floor, seen_from_behind, sharing_a_plane
from scipy import ndimage

from deux.contracts import COLOR, Robot, Scene, SceneMesh
from deux.errors import DeuxError
from deux.figures.scene_views import texture_contrast
from deux.geometry.camera import Camera
from deux.geometry.grid import FreeSpace
from deux.geometry.poses import camera_pose
from deux.scenes.free_space import free_space
from deux.scenes.ray_caster import Hits, RayCaster
from deux.simulator.mesh_simulator import MeshSimulator
from deux.simulator.starts import random_starts
from deux_plugins.scenes.apartments import apartment
from deux_plugins.scenes.houses import HOUSE_VERSION, house
from deux_plugins.scenes.houses.generator import house_plan
from deux_plugins.scenes.parts.labels import LABEL_NAMES

DIGEST_OF_SEED_2 = "222a394bf53ec7ce52ccbcc3aecf66300354eaaf2c05b1e3c0b30df4fffb0bbf"
"""Of version 1. If it changes, either something became machine-dependent or HOUSE_VERSION has to be raised."""

RADIUS, HEAD = 0.1, 1.5
"""The robot's radius and height, metres."""


@pytest.fixture(scope="module")
def caster(building: Scene) -> RayCaster:
    return RayCaster(building.mesh)


@pytest.fixture(scope="module")
def space(building: Scene, caster: RayCaster) -> FreeSpace:
    return free_space(building.mesh, building.floor_height, Robot(), caster=caster)


@pytest.fixture(scope="module")
def rays(space: FreeSpace) -> Rays:
    return rays_from_the_floor(space)


@pytest.fixture(scope="module")
def hits(caster: RayCaster, rays: Rays) -> Hits:
    return caster.cast(*rays)


def open_floor(mesh: SceneMesh, cell: float = 0.05) -> np.ndarray:
    """Where the robot fits, told from vertical rays alone: nothing between the floor and its head within its radius."""
    low, high = mesh.bounds[:, [0, 2]]
    x, z = np.meshgrid(*(np.arange(low[i], high[i], cell) + cell / 2 for i in range(2)))
    origins = np.stack([x.ravel(), np.full(x.size, HEAD), z.ravel()], axis=1)
    below = RayCaster(mesh).cast(origins, np.broadcast_to([0.0, -1.0, 0.0], origins.shape))
    clear = (below.face >= 0) & (HEAD - below.distance < 0.05)
    distance = ndimage.distance_transform_edt(np.pad(clear.reshape(x.shape), 1))[1:-1, 1:-1] * cell
    return distance >= RADIUS + cell / 2


def contrasts(scene: Scene, views: int = 60) -> np.ndarray:
    """Contrast of views from random places."""
    simulator = MeshSimulator(scene, Camera(64, 64), Robot())
    places = random_starts(simulator.free_space(), views, np.random.default_rng(0))
    poses = np.stack([camera_pose(x, 1.25, z, yaw) for x, z, yaw in places])
    return np.array([texture_contrast(frame.rgb) for frame in simulator.render(poses, COLOR)])


def test_a_seed_always_gives_the_same_bytes(houses: dict[int, Scene]):
    assert HOUSE_VERSION == 1
    assert digest(houses[2]) == DIGEST_OF_SEED_2


def test_another_process_gives_the_same_bytes(houses: dict[int, Scene]):
    program = (
        "import hashlib; from deux_plugins.scenes.houses import house; "
        "print(hashlib.sha256(house(2).mesh.vertices.tobytes()).hexdigest())"
    )
    other = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert other.stdout.strip() == hashlib.sha256(houses[2].mesh.vertices.tobytes()).hexdigest()


def test_no_two_houses_are_alike(houses: dict[int, Scene]):
    plans = [house_plan(seed) for seed in range(100)]
    assert len({plan.rooms for plan in plans}) == len(plans)
    textures = [{m.texture.tobytes() for m in scene.mesh.materials} for scene in (*houses.values(), apartment(2))]
    assert not set.intersection(textures[0], textures[1])
    assert not set.intersection(textures[1], textures[2]), "the house of a seed shares textures with the flat of it"


def test_name_and_identity(houses: dict[int, Scene]):
    assert houses[2].name == "house-00002"
    assert houses[2].identity == f"house:{HOUSE_VERSION}:150-500:2"
    assert houses[2].floors[0].area == pytest.approx(sum(room.area for room in house_plan(2).rooms))


def test_a_negative_seed_is_refused():
    with pytest.raises(DeuxError, match="-3"):
        house(-3)


def test_size_is_modest(building: Scene):
    mesh = building.mesh
    assert 15_000 <= len(mesh.faces) <= 60_000
    textures = {id(material.texture): material.texture.nbytes for material in mesh.materials}
    assert sum(textures.values()) < 32e6
    assert mesh.bounds[0, 1] == 0.0


def test_furniture_is_varied_and_labelled_as_in_flats(building: Scene):
    assert building.mesh.label_names == LABEL_NAMES
    kinds = {LABEL_NAMES[label] for label in np.unique(building.mesh.face_label)} - STRUCTURE
    assert len(kinds) >= 18
    assert {"bed", "sofa", "toilet", "counter", "shelf", "lamp"} <= kinds


def test_the_robot_sees_geometry_in_every_direction(hits: Hits):
    assert (hits.face >= 0).all()
    assert hits.distance.min() > 0.1


def test_visible_faces_look_at_the_robot(building: Scene, rays: Rays, hits: Hits):
    assert seen_from_behind(building, rays, hits) < 5e-4


def test_no_two_visible_faces_share_a_plane(building: Scene, caster: RayCaster, rays: Rays, hits: Hits):
    assert sharing_a_plane(building, caster, rays, hits) < 2e-4


@pytest.mark.parametrize("seed", range(20, 28))
def test_one_connected_part_holds_the_free_floor(seed: int):
    scene = house(seed)
    parts, _ = ndimage.label(open_floor(scene.mesh))
    sizes = np.bincount(parts.ravel())[1:]
    assert sizes.max() / sizes.sum() > 0.97
    space = free_space(scene.mesh, 0.0, Robot())
    assert space.area == pytest.approx(sizes.max() * 0.05**2, rel=0.1)
    for room in house_plan(seed).rooms:
        low, high = space.frame.cell(room.x0, room.z0), space.frame.cell(room.x1, room.z1)
        assert space.free[low[0] : high[0], low[1] : high[1]].mean() > 0.1, room.kind


def test_doorways_are_passable_for_a_wider_robot(houses: dict[int, Scene]):
    for seed, scene in houses.items():
        space = free_space(scene.mesh, 0.0, Robot(radius=0.25))
        for door in house_plan(seed).doors:
            middle = (door.low + door.high) / 2
            row, column = space.frame.cell(*((middle, door.wall) if door.axis == "x" else (door.wall, middle)))
            assert space.free[row, column], (seed, door)


def test_views_differ_in_difficulty_more_than_in_flats(houses: dict[int, Scene]):
    """The plainest tenth of the views has less than half of the contrast that the richest tenth has."""
    in_house = np.concatenate([contrasts(scene) for scene in houses.values()])
    in_flat = contrasts(apartment(0))
    low, high = np.percentile(in_house, (10, 90))
    assert high > 2.2 * low
    assert low < 0.6 * np.percentile(in_flat, 10)
    assert np.percentile(in_house, 1) > 0.1, "a view without any texture teaches nothing at all"


def test_light_varies_but_never_hides_the_texture(building: Scene):
    brightness = building.mesh.vertex_colors.mean(axis=1)
    assert brightness.min() > 100
    assert brightness.std() > 8
