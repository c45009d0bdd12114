import logging
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image

from deux.contracts import Scene
from deux.geometry.camera import Camera
from deux.geometry.poses import camera_pose
from deux.mesh_files.mesh_reader import read_mesh
from deux.scenes import prepared_scene as module
from deux.scenes.mesh_scene import mesh_scene
from deux.scenes.prepared_scene import prepared_scene
from deux.simulator.embree_renderer import EmbreeRenderer

MAPPED_BY = """
import sys
from pathlib import Path
from deux.scenes.prepared_scene import prepared_scene
scene = prepared_scene(Path(sys.argv[1]), "test:room", None)
print(len(scene.mesh.faces), scene.mesh.materials[0].texture.sum())
"""


@pytest.fixture
def room_file(tmp_path) -> Path:
    """A scan as large ones are: faces with two textures, far from the origin of its coordinates."""
    room = trimesh.creation.box(bounds=[[0, 0, 0], [5, 2.5, 4]]).subdivide()
    rng = np.random.default_rng(0)
    for k in range(2):
        Image.fromarray(rng.integers(0, 256, (20 + k, 30, 3), np.uint8)).save(tmp_path / f"t{k}.png")
    (tmp_path / "room.mtl").write_text("newmtl a\nmap_Kd t0.png\nnewmtl b\nmap_Kd t1.png\nnewmtl c\nKd 1 0 0\n")
    lines = [f"v {x + 448_000} {y} {z}\nvt {x} {y + z}" for x, y, z in room.vertices]
    for k, face in enumerate(room.faces + 1):
        lines.append(f"usemtl {'abc'[k % 3]}\nf " + " ".join(f"{v}/{v}" for v in face))
    (tmp_path / "room.obj").write_text("mtllib room.mtl\n" + "\n".join(lines))
    return tmp_path / "room.obj"


@pytest.fixture
def make(room_file):
    """A function that loads the room, and counts how often it did in its attribute `calls`."""

    def load() -> Scene:
        load.calls += 1
        return mesh_scene("room", read_mesh(room_file), "test:room", "room.obj")

    load.calls = 0
    return load


def assert_equal(one: Scene, other: Scene) -> None:
    assert (one.name, one.identity, one.floors) == (other.name, other.identity, other.floors)
    assert (one.mesh.origin, one.mesh.label_names) == (other.mesh.origin, other.mesh.label_names)
    for name in ("vertices", "faces", "uv", "face_material", "face_label", "vertex_colors"):
        mine, its = getattr(one.mesh, name), getattr(other.mesh, name)
        np.testing.assert_array_equal(mine, its)
        assert mine is None or mine.dtype == its.dtype
    for mine, its in zip(one.mesh.materials, other.mesh.materials, strict=True):
        assert (mine.name, mine.color) == (its.name, its.color)
        np.testing.assert_array_equal(mine.texture, its.texture)


def test_a_prepared_scene_is_the_scene(tmp_path, make):
    made = make()
    first = prepared_scene(tmp_path / "prepared", "test:room", make)
    second = prepared_scene(tmp_path / "prepared", "test:room", make)
    assert make.calls == 2, "the second time nothing is read"
    for opened in (first, second):
        assert_equal(opened, made)
    assert prepared_scene(None, "test:room", make).mesh.pyramids is not None
    assert make.calls == 3


def test_it_is_drawn_as_the_scene_is(tmp_path, make):
    opened = prepared_scene(tmp_path, "test:room", make)
    pose = camera_pose(2.5, 1.25, 2.0, 0.4)[None]
    images = [EmbreeRenderer(scene.mesh, Camera(64, 64)).render(pose)[0] for scene in (make(), opened)]
    np.testing.assert_array_equal(images[0].rgb, images[1].rgb)
    np.testing.assert_array_equal(images[0].depth, images[1].depth)
    assert len(np.unique(images[0].rgb.reshape(-1, 3), axis=0)) > 100


def test_large_arrays_are_mapped_and_shared_by_processes(tmp_path, make):
    scene = prepared_scene(tmp_path, "test:room", make)
    maps = Path("/proc/self/maps")
    if maps.exists():
        assert sum(str(tmp_path) in line for line in maps.read_text().splitlines()) >= 6
    run = subprocess.run([sys.executable, "-c", MAPPED_BY, str(tmp_path)], capture_output=True, text=True, check=True)
    assert run.stdout.split() == [str(len(scene.mesh.faces)), str(scene.mesh.materials[0].texture.sum())]


def test_other_identities_and_versions_are_prepared_anew(tmp_path, make, monkeypatch):
    prepared_scene(tmp_path, "test:room", make)
    prepared_scene(tmp_path, "test:other", make)
    monkeypatch.setattr(module, "VERSION", module.VERSION + 1)
    prepared_scene(tmp_path, "test:room", make)
    assert make.calls == 3
    assert len(list(tmp_path.glob("[0-9a-f]*/scene.json"))) == 3


def test_where_nothing_can_be_written_the_scene_is_used_all_the_same(tmp_path, make, caplog):
    (tmp_path / "file").touch()
    scene = prepared_scene(tmp_path / "file" / "prepared", "test:room", make)
    assert_equal(scene, make())
    assert "is not prepared" in caplog.text


def test_what_was_cut_off_leaves_nothing_behind(tmp_path, make, monkeypatch, caplog):
    def full_disk(*_: object) -> None:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(module.np, "save", full_disk)
        prepared_scene(tmp_path / "prepared", "test:room", make)
    assert "The disk is full" in caplog.text
    assert list((tmp_path / "prepared").iterdir()) == []


def test_two_processes_at_once_make_it_once(tmp_path, make):
    """The second one finds the place taken when it is done, and uses what is there."""

    def make_twice() -> Scene:
        prepared_scene(tmp_path, "test:room", make)
        return make()

    assert_equal(prepared_scene(tmp_path, "test:room", make_twice), make())
    assert len(list(tmp_path.glob("*/scene.json"))) == 1
    assert not list(tmp_path.glob(".*/"))


def test_what_it_takes_is_reported(tmp_path, make, caplog):
    with caplog.at_level(logging.INFO):
        prepared_scene(tmp_path, "test:room", make)
    assert str(tmp_path) in caplog.text
