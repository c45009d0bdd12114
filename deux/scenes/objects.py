"""The object instances of a labelled scene: which faces of one label belong to the same chair."""

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
"""Names of labels whose faces belong to no object: the building's, and those that say nothing."""


@dataclass(frozen=True)
class SceneObjects:
    """Which object each face belongs to.

    Args:
        face_object: F int32, index into `labels`, -1 where a face belongs to no object.
        labels: the label of each object, by name.
    """

    face_object: np.ndarray
    labels: tuple[str, ...]


def find_objects(mesh: SceneMesh, gap: float = 0.05) -> SceneObjects:
    """Tell the objects of a scene apart: as the mesh does, or faces of one label belong together where they are near.

    Where the mesh has no `face_object`, space is divided into cubes with edges of `gap`. Faces of one label that pass
    through the same cube, or through cubes that touch, are of one object, and so are all that are joined in this way.
    Surfaces of one label less than a `gap` apart are thus always one object (the legs and the seat of a chair, the
    books of a row) and those more than two apart never are.

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
    # Labels are two units apart in a coordinate of their own, so that cubes of different labels never touch.
    cubes = np.column_stack([2 * mesh.face_label[faces][owner], np.floor(points / gap).astype(np.int64)])
    cubes, cube_of_point = np.unique(cubes, axis=0, return_inverse=True)
    touching = cKDTree(cubes).query_pairs(1.0, p=np.inf, output_type="ndarray")
    links = coo_array((np.ones(len(touching)), touching.T), (len(cubes), len(cubes)))
    count, object_of_cube = connected_components(links, directed=False)
    # A face's neighbouring points are less than a gap apart, so all of its cubes are of one object.
    face_object[faces[owner]] = object_of_cube[cube_of_point.ravel()]
    label_of_object = np.empty(count, np.int64)
    label_of_object[object_of_cube] = cubes[:, 0] // 2
    return SceneObjects(face_object, tuple(mesh.label_names[label] for label in label_of_object))


def _given_objects(mesh: SceneMesh, numbers: np.ndarray, labelled: np.ndarray) -> SceneObjects:
    """The objects that the mesh itself tells apart, each with the label of its first face.

    Args:
        mesh: the scene.
        numbers: the object of each face, F, any numbers, -1 for none.
        labelled: the faces whose label may be an object's.
    """
    faces = labelled[numbers[labelled] >= 0]
    _, first, index = np.unique(numbers[faces], return_index=True, return_inverse=True)
    face_object = np.full(len(mesh.faces), -1, np.int32)
    face_object[faces] = index
    return SceneObjects(face_object, tuple(mesh.label_names[label] for label in mesh.face_label[faces[first]]))


def _surface_points(triangles: np.ndarray, spacing: float) -> tuple[np.ndarray, np.ndarray]:
    """Points on triangles (F x 3 x 3), no neighbours farther apart than `spacing`; P x 3, and each one's triangle."""
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
