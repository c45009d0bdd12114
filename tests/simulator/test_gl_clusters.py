from collections.abc import Callable

import numpy as np

from deux.contracts import Material, Scene
from deux.geometry.camera import Camera
from deux.geometry.poses import camera_pose
from deux.simulator.embree_renderer import EmbreeRenderer
from deux.simulator.gl_clusters import Frustum, likely_occluders, make_clusters

CAMERA = Camera(80, 60, 70.0)


def test_every_triangle_is_in_one_cluster_and_its_box(flat: Scene) -> None:
    clusters = make_clusters(flat.mesh, most=20)
    np.testing.assert_array_equal(np.sort(clusters.order), np.arange(len(flat.mesh.faces)))
    assert clusters.size.max() <= 20
    number = np.repeat(np.arange(len(clusters.size)), clusters.size)
    corners = flat.mesh.triangles[clusters.order]
    assert (np.abs(corners - clusters.center[number][:, None]) <= clusters.extent[number][:, None]).all()
    length = np.ptp(corners, axis=1).max(axis=1)
    np.testing.assert_array_equal(clusters.large[number], length > 0.5)


def test_whatever_a_ray_meets_is_kept_and_much_is_left_out(flat: Scene, flat_poses: list[np.ndarray]) -> None:
    clusters = make_clusters(flat.mesh)
    cluster_of = np.empty(len(clusters.order), int)
    cluster_of[clusters.order] = np.repeat(np.arange(len(clusters.size)), clusters.size)
    frustum = Frustum(CAMERA)
    images = EmbreeRenderer(flat.mesh, CAMERA).render(np.stack(flat_poses), colors=False, faces=True)
    kept, left = 0, 0
    for pose, image in zip(flat_poses, images, strict=True):
        met = np.unique(cluster_of[image.face[image.face >= 0]])
        within = frustum.within(clusters, pose)
        assert np.isin(met, within).all()
        left_open = frustum.not_hidden(clusters, within, pose, image.depth)
        assert np.isin(met, left_open).all()
        kept, left = kept + len(left_open), left + len(clusters.size) - len(left_open)
        distance = np.linalg.norm(
            np.maximum(np.abs(clusters.center[within] - pose[:3, 3]) - clusters.extent[within], 0.0), axis=1
        )
        assert (np.diff(distance) >= -1e-9).all()
    assert left > kept


def test_a_wall_hides_what_is_behind_it_and_not_what_is_beside_it(make_quads: Callable[..., Scene]) -> None:
    def square(x: float, z: float, half: float) -> list[list[float]]:
        return [[x - half, -half, z], [x + half, -half, z], [x + half, half, z], [x - half, half, z]]

    places = np.array([square(0.0, -2.0, 1.0), square(0.0, -4.0, 0.2), square(3.2, -4.0, 0.2), square(0.0, 4.0, 0.2)])
    scene = make_quads(places, tuple(Material(str(i)) for i in range(4)))
    clusters = make_clusters(scene.mesh, most=1)
    pose = camera_pose(0.0, 0.0, 0.0, 0.0)
    camera = Camera(90, 90, 90.0)
    quad = clusters.order[clusters.first] // 2
    within = Frustum(camera).within(clusters, pose)
    assert set(quad[within]) == {0, 1, 2}
    assert set(quad[within[likely_occluders(clusters, within)]]) == {0}
    depth = np.zeros((90, 90), np.float32)
    depth[22:68, 22:68] = 2.0
    assert set(quad[Frustum(camera).not_hidden(clusters, within, pose, depth)]) == {0, 2}
    assert len(Frustum(camera).not_hidden(clusters, within, pose, np.zeros_like(depth))) == len(within)


def test_a_mesh_of_no_triangles(make_quads: Callable[..., Scene]) -> None:
    clusters = make_clusters(make_quads(np.zeros((0, 4, 3)), ()).mesh)
    assert len(clusters.order) == len(clusters.size) == 0
    assert len(Frustum(CAMERA).within(clusters, np.eye(4))) == 0
