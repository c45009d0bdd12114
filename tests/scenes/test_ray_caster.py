import pickle

import numpy as np
import pytest
import trimesh

from deux.scenes.ray_caster import RayCaster


def test_distances_to_a_sphere_are_the_analytic_ones(mesh_of):
    caster = RayCaster(mesh_of(trimesh.creation.icosphere(subdivisions=5, radius=2.0)))
    heights = np.linspace(-1.5, 1.5, 31)
    origins = np.stack([np.full(31, -5.0), heights, np.zeros(31)], axis=-1)
    hits = caster.cast(origins, np.broadcast_to([1.0, 0.0, 0.0], origins.shape))
    np.testing.assert_allclose(hits.distance, 5.0 - np.sqrt(4.0 - heights**2), atol=3e-3)


def test_distance_is_in_units_of_the_direction(mesh_of, slab):
    caster = RayCaster(mesh_of(slab([-1, -1, 4], [1, 1, 5])))
    slanted = np.array([[0.2, -0.1, 1.0], [0.4, -0.2, 2.0]])
    hits = caster.cast(np.zeros((2, 3)), slanted)
    np.testing.assert_allclose(hits.distance, [4.0, 2.0], rtol=1e-6)


def test_a_miss_is_infinite_and_has_no_face(mesh_of, slab):
    hits = RayCaster(mesh_of(slab([0, 0, 0], [1, 1, 1]))).cast([[5.0, 5.0, 5.0]], [[0.0, 1.0, 0.0]])
    assert np.isinf(hits.distance[0])
    assert hits.face[0] == -1


def test_no_rays_give_no_hits(mesh_of, slab):
    hits = RayCaster(mesh_of(slab([0, 0, 0], [1, 1, 1]))).cast(np.zeros((0, 3)), np.zeros((0, 3)))
    assert len(hits.distance) == len(hits.face) == len(hits.barycentric) == 0


def test_faces_and_barycentric_coordinates_name_the_point(small_house, house_caster):
    rng = np.random.default_rng(1)
    origins = np.tile([1.0, 1.25, 0.0], (500, 1))
    directions = rng.normal(size=(500, 3))
    hits = house_caster.cast(origins, directions)
    met = hits.face >= 0
    assert met.mean() > 0.9
    a, b, c = small_house.mesh.triangles[hits.face[met]].transpose(1, 0, 2)
    u, v = hits.barycentric[met].T[..., None]
    points = (1 - u - v) * a + u * b + v * c
    expected = origins[met] + hits.distance[met, None] * directions[met]
    np.testing.assert_allclose(points, expected, atol=2e-4)


def nearest_by_brute_force(triangles, origin, direction):
    """Distance to the nearest triangle (K x 3 x 3) along one ray, by solving for each triangle's coordinates."""
    a, b, c = triangles.astype(np.float64).transpose(1, 0, 2)
    system = np.stack([b - a, c - a, np.broadcast_to(-direction, a.shape)], axis=-1)
    u, v, distance = np.linalg.solve(system, (origin - a)[..., None])[..., 0].T
    met = (u >= 0) & (v >= 0) & (u + v <= 1) & (distance >= 0)
    return distance[met].min(initial=np.inf)


def test_agrees_with_brute_force(mesh_of):
    mesh = mesh_of(trimesh.creation.torus(2.0, 0.5))
    rng = np.random.default_rng(2)
    origins, directions = rng.uniform(-2, 2, (200, 3)), rng.normal(size=(200, 3))
    hits = RayCaster(mesh).cast(origins, directions)
    expected = [nearest_by_brute_force(mesh.triangles, *ray) for ray in zip(origins, directions, strict=True)]
    assert 20 < np.isfinite(expected).sum() < 180
    np.testing.assert_allclose(hits.distance, expected, rtol=1e-4)


def test_a_used_caster_travels_to_other_processes(mesh_of, slab):
    caster = RayCaster(mesh_of(slab([-1, -1, 4], [1, 1, 5])))
    ray = np.zeros((1, 3)), np.array([[0.0, 0.0, 1.0]])
    caster.cast(*ray)
    assert pickle.loads(pickle.dumps(caster)).cast(*ray).distance[0] == pytest.approx(4.0)


def test_all_surfaces_below_are_found_from_the_highest_down(mesh_of, slab, sheet):
    tilted = sheet([0, 3, 0], [2, 4, 0], [2, 4, 2], [0, 3, 2])
    caster = RayCaster(mesh_of(slab([0, 0, 0], [2, 1, 2]), tilted, slab([0, 1, 0], [1, 2, 2])))
    heights, faces = caster.surfaces_below(np.array([[0.5, 0.7], [1.5, 1.3], [5.0, 1.0]]))
    expected = np.array([[3.25, 3.75, np.nan], [2.0, 1.0, np.nan], [1.0, 0.0, np.nan], [0.0, np.nan, np.nan]])
    np.testing.assert_allclose(heights, expected, atol=1e-5)
    np.testing.assert_array_equal(faces >= 0, np.isfinite(expected))
    met = caster.mesh.triangles[faces[0, 0]]
    assert (met[:, 1].min(), met[:, 1].max()) == (3.0, 4.0)
    assert caster.surfaces_below(np.array([[5.0, 1.0]]))[0].shape == (0, 1)
