"""Object instances of a labelled scene: which faces with the same label belong to the same object."""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from deux.contracts import SceneMesh

NO_OBJECTS = frozenset(
    {"wall", "floor", "ceiling", "door frame", "door", "window", "stairs", "column", "beam", "railing"}
    | {"unlabeled", "undefined"}
)
"""Labels that are not objects: parts of the building, and unlabelled faces."""


@dataclass(frozen=True)
class SceneObjects:
    """The object instances of a scene.

    Args:
        face_object: F int32, index into `labels`, -1 if the face belongs to no object.
        labels: the name of each object's label.
    """

    face_object: np.ndarray
    labels: tuple[str, ...]


def find_objects(mesh: SceneMesh, gap: float = 0.05) -> SceneObjects:
    """Segment a scene into objects: by the mesh's own instances, or by connecting nearby faces with the same label.

    If the mesh has no `face_object`, space is divided into cubes with edges of `gap`. Faces with the same label that
    pass through the same cube or touching cubes are connected, and connected faces are one object. So surfaces with the
    same label that are less than a `gap` apart are always one object (the legs and the seat of a chair, the books of a
    row), and those more than two gaps apart are not, unless others connect them.

    Args:
        mesh: the scene.
        gap: metres.
    """
    counted = np.array([name not in NO_OBJECTS for name in mesh.label_names] + [False])  # label -1 is the last one
    faces = np.flatnonzero(counted[mesh.face_label])
    face_object = np.full(len(mesh.faces), -1, np.int32)
    if len(faces) == 0:
        return SceneObjects(face_object, ())
    if mesh.face_object is not None:
        return _given_objects(mesh, mesh.face_object, faces)
    points, owner = _surface_points(mesh.triangles[faces].astype(np.float64), gap)
    # In the first coordinate labels are two units apart, so that cubes of different labels never touch.
    cubes = np.column_stack([2 * mesh.face_label[faces][owner], np.floor(points / gap).astype(np.int64)])
    cubes, cube_of_point = np.unique(cubes, axis=0, return_inverse=True)
    touching = cKDTree(cubes).query_pairs(1.0, p=np.inf, output_type="ndarray")
    links = coo_array((np.ones(len(touching)), touching.T), (len(cubes), len(cubes)))
    count, object_of_cube = connected_components(links, directed=False)
    # Neighbouring points of a face are less than a gap apart, so all of its cubes are connected.
    face_object[faces[owner]] = object_of_cube[cube_of_point.ravel()]
    label_of_object = np.empty(count, np.int64)
    label_of_object[object_of_cube] = cubes[:, 0] // 2
    return SceneObjects(face_object, tuple(mesh.label_names[label] for label in label_of_object))


def _given_objects(mesh: SceneMesh, numbers: np.ndarray, labelled: np.ndarray) -> SceneObjects:
    """The object instances that the mesh defines, each with the label of its first face.

    Args:
        mesh: the scene.
        numbers: F, the object number of each face, -1 for none.
        labelled: the faces whose label can be an object's.
    """
    faces = labelled[numbers[labelled] >= 0]
    _, first, index = np.unique(numbers[faces], return_index=True, return_inverse=True)
    face_object = np.full(len(mesh.faces), -1, np.int32)
    face_object[faces] = index
    return SceneObjects(face_object, tuple(mesh.label_names[label] for label in mesh.face_label[faces[first]]))


def _surface_points(triangles: np.ndarray, spacing: float) -> tuple[np.ndarray, np.ndarray]:
    """Sample points on F x 3 x 3 triangles at most `spacing` apart; returns P x 3 points and the triangle of each."""
    edges = np.linalg.norm(triangles - np.roll(triangles, 1, axis=1), axis=2)
    pieces = np.maximum(np.ceil(edges.max(axis=1) / spacing), 1).astype(np.int64)
    points, owners = [], []
    for number in np.unique(pieces):
        same = np.flatnonzero(pieces == number)
        a, b = np.meshgrid(np.arange(number + 1), np.arange(number + 1))
        a, b = a[a + b <= number], b[a + b <= number]
        weights = np.stack([number - a - b, a, b], axis=1) / number
        points.append((weights @ triangles[same]).reshape(-1, 3))
        owners.append(np.repeat(same, len(weights)))
    return np.concatenate(points), np.concatenate(owners)
