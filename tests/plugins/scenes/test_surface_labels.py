import numpy as np
import pytest
from scan_scenes import room, write_ply

from deux.contracts import Material, SceneMesh
from deux.errors import DeuxError
from deux_plugins.scenes.surface_labels import (
    LabelledSurface,
    labelled_surface,
    look_up,
    read_annotated_ply,
    surface_samples,
)


def test_samples_are_the_centroids_of_equal_parts():
    triangles = np.array([[[0, 0, 0], [3, 0, 0], [0, 0, 4.0]], [[0, 1, 0], [0.1, 1, 0], [0, 1, 0.1]]])
    owner, weights = surface_samples(triangles, spacing=1.0)
    assert np.bincount(owner).tolist() == [25, 1], "5 m need five pieces along each edge"
    assert (weights > 0).all()
    np.testing.assert_allclose(weights.sum(axis=1), 1.0)
    points = np.einsum("pk,pkd->pd", weights, triangles[owner])
    for k in range(2):
        np.testing.assert_allclose(points[owner == k].mean(axis=0), triangles[k].mean(axis=0))
    # The second moments of 25 equal parts about their own centroids add up with those of the points to the whole's.
    whole = _second_moment(triangles[0])
    parts = _second_moment(triangles[0] / 5)
    spread = points[owner == 0] - triangles[0].mean(axis=0)
    np.testing.assert_allclose(spread.T @ spread / 25 + parts, whole, atol=1e-12)


def _second_moment(triangle: np.ndarray) -> np.ndarray:
    """The mean of x x^T over a triangle about its centroid: sum of those of its corners over 12."""
    corners = triangle - triangle.mean(axis=0)
    return corners.T @ corners / 12


def test_no_point_of_a_surface_is_far_from_a_sample():
    rng = np.random.default_rng(0)
    triangle = np.array([[[0, 0, 0], [2, 0, 0.5], [0.3, 1, 1.0]]])
    _, weights = surface_samples(triangle, spacing=0.1)
    samples = weights @ triangle[0]
    random = rng.dirichlet([1, 1, 1], 2000) @ triangle[0]
    nearest = np.linalg.norm(random[:, None] - samples, axis=2).min(axis=1)
    assert nearest.max() <= 0.1


def test_keys_are_looked_up():
    keys = np.array([[5, -1], [7, 3]])
    assert look_up({7: 70, 5: 50}, keys).tolist() == [[50, -1], [70, -1]]
    assert look_up({}, keys).tolist() == [[-1, -1], [-1, -1]]


@pytest.mark.parametrize("ascii_", [True, False])
@pytest.mark.parametrize("corners", ["faces", "quads"])
def test_numbers_of_faces_are_read(tmp_path, ascii_, corners):
    made = room()
    faces = getattr(made, corners)
    write_ply(
        tmp_path / "a.ply", made.vertices, faces, ascii_, object_id=np.arange(len(faces)), other=-np.ones(len(faces))
    )
    triangles, numbers = read_annotated_ply(tmp_path / "a.ply")
    assert (triangles.shape, sorted(numbers)) == ((24, 3, 3), ["object_id", "other"])
    turned = made.vertices[:, [0, 2, 1]] * (1, 1, -1)
    for triangle, number in zip(triangles, numbers["object_id"], strict=True):
        assert {tuple(c) for c in triangle.round(5)} <= {tuple(c) for c in turned[faces[number]].round(5)}
    areas = np.linalg.norm(np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]), axis=1) / 2
    assert areas.sum() == pytest.approx(2 * (12 + 10 + 7.5) + 2 * 0.16 + 4 * 0.36)


def test_a_file_of_something_else_is_reported(tmp_path):
    (tmp_path / "a.ply").write_bytes(b"ply\nformat ascii 1.0\nend_header\n")
    with pytest.raises(DeuxError, match=r"a\.ply contains no faces"):
        read_annotated_ply(tmp_path / "a.ply")


def test_a_real_scene_gets_its_own_labels_back(small_house):
    """Labelled by its own materials: only faces that lie on another material's may take that one's.

    The house has carpets of several sheets, a millimetre above one another and the floor, 53 m2 in all.
    """
    mesh = small_house.mesh
    names = tuple(f"material {k}" for k in range(len(mesh.materials)))
    surface = labelled_surface(mesh.triangles.astype(np.float64), mesh.face_material, mesh.face_material + 100, names)
    found = surface.label(mesh, "small_house")
    right = found.face_label == mesh.face_material
    areas = np.linalg.norm(np.cross(*np.diff(mesh.triangles, axis=1).transpose(1, 0, 2)), axis=1) / 2
    assert right.mean() > 0.99
    assert areas[right].sum() > 0.9 * areas.sum()
    assert (found.face_object == found.face_label + 100).all()


def test_a_large_face_takes_what_most_of_it_lies_on():
    """A floor of two triangles, labelled by small ones: a rug below its centroid does not name it."""
    floor = np.array([[[0, 0, 0], [6, 0, 0], [0, 0, 6.0]]])
    _, weights = surface_samples(floor, spacing=0.1)
    places = weights @ floor[0]
    rug = np.linalg.norm(places - floor[0].mean(axis=0), axis=1) < 0.5
    surface = LabelledSurface(places, rug.astype(np.int32), np.where(rug, 7, 3).astype(np.int32), ("floor", "rug"))
    mesh = SceneMesh(
        vertices=floor[0].astype(np.float32),
        faces=np.array([[0, 1, 2]], np.int32),
        uv=np.zeros((1, 3, 2), np.float32),
        face_material=np.zeros(1, np.int32),
        materials=(Material("grey"),),
        face_label=np.full(1, -1, np.int32),
    )
    labelled = surface.label(mesh, "hall")
    assert (labelled.face_label.tolist(), labelled.face_object.tolist()) == ([0], [3])
