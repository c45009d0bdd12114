import numpy as np
import pytest

from deux.bench.scenes import BenchScene, flat, free_poses, split_faces
from deux.contracts import Robot, Scene
from deux.geometry.camera import Camera
from deux.scenes.free_space import free_space
from deux.simulator.embree_renderer import EmbreeRenderer


@pytest.fixture(scope="module")
def scene() -> Scene:
    return flat(0).load()


def test_a_scene_with_split_faces_looks_the_same(scene: Scene) -> None:
    finer = BenchScene(flat(0), 20_000).load()
    assert 20_000 <= len(finer.mesh.faces) < 20_003
    camera = Camera(64, 64)
    renderers = EmbreeRenderer(scene, camera), EmbreeRenderer(finer, camera)
    for pose in free_poses(scene, Robot(), count=4, seed=1):
        whole, split = (renderer.render(pose) for renderer in renderers)
        assert whole.labels is not None
        same = np.abs(whole.depth - split.depth) < 1e-3
        assert same.mean() > 0.999
        assert (whole.labels == split.labels).mean() > 0.999
        # A face's colours are interpolated linearly, and its quarters' colours are rounded once more.
        assert np.abs(whole.rgb.astype(int) - split.rgb).max(axis=-1)[same].mean() < 1.0


def test_splitting_keeps_the_area_of_each_material(scene: Scene) -> None:
    def areas(mesh: object) -> np.ndarray:
        corners = mesh.triangles.astype(np.float64)  # type: ignore[attr-defined]
        area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 2
        return np.bincount(mesh.face_material, area)  # type: ignore[attr-defined]

    np.testing.assert_allclose(areas(split_faces(scene.mesh, 60_000)), areas(scene.mesh), rtol=1e-4)


def test_poses_stand_on_the_free_floor(scene: Scene) -> None:
    space = free_space(scene.mesh, scene.floor_height, Robot())
    poses = free_poses(scene, Robot(), count=50, seed=2)
    assert all(space.free[space.frame.cell(pose[0, 3], pose[2, 3])] for pose in poses)
    assert len({pose.tobytes() for pose in poses}) == 50
