import numpy as np
import pytest

from deux.mesh_files.polygons import triangulate

L_SHAPE = np.array([(2, 4), (2, 2), (4, 2), (4, 0), (0, 0), (0, 4)], float)


def areas(triangles: np.ndarray) -> np.ndarray:
    edges = triangles[:, 1:] - triangles[:, :1]
    return np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1) / 2


def star(corners: int, rng: np.random.Generator) -> np.ndarray:
    """A polygon around the origin whose corners are at random distances, counter-clockwise."""
    angle = np.arange(corners) * 2 * np.pi / corners
    return np.stack([np.cos(angle), np.sin(angle)], axis=1) * rng.uniform(0.2, 3.0, (corners, 1))


def shoelace(polygon: np.ndarray) -> float:
    x, y = polygon.T
    return abs(float(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1)))) / 2


def test_polygons_of_any_shape_and_plane_keep_their_area() -> None:
    rng = np.random.default_rng(0)
    flat = [L_SHAPE, L_SHAPE[::-1], *(star(n, rng) for n in (3, 4, 4, 5, 9, 30))]
    points, lengths = [], []
    for polygon in flat:
        axes = np.linalg.qr(rng.normal(size=(3, 3)))[0][:2]
        points.append(polygon @ axes + rng.normal(size=3) * 100)
        lengths.append(len(polygon))
    corners, owner = triangulate(np.concatenate(points), np.array(lengths))
    found = np.bincount(owner, areas(np.concatenate(points)[corners]))
    np.testing.assert_allclose(found, [shoelace(polygon) for polygon in flat], rtol=1e-9)
    starts = np.cumsum(lengths) - lengths
    assert (corners >= starts[owner][:, None]).all()
    assert (corners < (starts + lengths)[owner][:, None]).all()


def test_the_triangles_of_a_concave_polygon_do_not_overlap_or_leave_it() -> None:
    points = np.insert(L_SHAPE, 1, 0.0, axis=1)
    corners, _ = triangulate(points, np.array([6]))
    centres = points[corners].mean(axis=1)
    assert not ((centres[:, 0] > 2) & (centres[:, 2] > 2)).any(), "the part that is cut out"
    assert areas(points[corners]).sum() == pytest.approx(12.0)


def test_degenerate_polygons_have_no_triangles_and_disturb_no_other() -> None:
    square = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], float)
    points = np.concatenate([square[:2], square, square[:1]])
    corners, owner = triangulate(points, np.array([2, 4, 1, 0]))
    np.testing.assert_array_equal(owner, [1, 1])
    assert areas(points[corners]).sum() == pytest.approx(1.0)
    assert triangulate(np.zeros((0, 3)), np.zeros(0, np.int64))[0].shape == (0, 3)


def test_collinear_corners_are_no_reason_for_holes() -> None:
    polygon = np.array([(0, 0, 0), (1, 0, 0), (2, 0, 0), (2, 2, 0), (1, 2, 0), (0, 2, 0)], float)
    corners, _ = triangulate(polygon, np.array([6]))
    assert areas(polygon[corners]).sum() == pytest.approx(4.0)
