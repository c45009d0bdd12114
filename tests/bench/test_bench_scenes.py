import numpy as np
import pytest

from deux.bench.bench_scenes import FinerScene, default_simulation, flats, free_poses, split_faces
from deux.contracts import Scene
from deux.geometry.camera import Camera
from deux.simulator.embree_renderer import EmbreeRenderer


@pytest.fixture(scope="module")
def scene() -> Scene:
    return flats(1)[0].load()


def test_there_are_as_many_flats_as_asked_for_and_always_the_same() -> None:
    assert flats(3)[:2] == flats(2)
    assert len({flat.identity for flat in flats(3)}) == 3


def test_a_scene_with_split_faces_looks_the_same(scene: Scene) -> None:
    (flat,) = flats(1)
    finer = FinerScene(flat.name, flat, 20_000).load()
    assert 20_000 <= len(finer.mesh.faces) < 20_003
    assert finer.identity != scene.identity
    camera = Camera(64, 64)
    poses = free_poses(default_simulation(64).make(flat), count=4, seed=1)
    drawn = [EmbreeRenderer(mesh, camera).render(poses, colors=True, faces=True) for mesh in (scene.mesh, finer.mesh)]
    for whole, split in zip(*drawn, strict=True):
        same = np.abs(whole.depth - split.depth) < 1e-3
        assert same.mean() > 0.999
        labels = scene.mesh.face_label[whole.face], finer.mesh.face_label[split.face]
        assert (labels[0] == labels[1]).mean() > 0.999
        # A face's colours are interpolated linearly, and its quarters' colours are rounded once more.
        assert np.abs(whole.rgb.astype(int) - split.rgb).max(axis=-1)[same].mean() < 1.0


def test_splitting_keeps_the_area_of_each_material(scene: Scene) -> None:
    def areas(mesh: object) -> np.ndarray:
        corners = mesh.triangles.astype(np.float64)  # type: ignore[attr-defined]
        area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 2
        return np.bincount(mesh.face_material, area)  # type: ignore[attr-defined]

    np.testing.assert_allclose(areas(split_faces(scene.mesh, 60_000)), areas(scene.mesh), rtol=1e-4)


def test_poses_stand_on_the_free_floor() -> None:
    simulator = default_simulation(8).make(flats(1)[0])
    space = simulator.free_space()
    poses = free_poses(simulator, count=50, seed=2)
    assert all(space.free[space.frame.cell(pose[0, 3], pose[2, 3])] for pose in poses)
    assert np.allclose(poses[:, 1, 3], space.floor_height + simulator.robot.camera_height)
    assert len({pose.tobytes() for pose in poses}) == 50
