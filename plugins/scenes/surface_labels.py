"""Transfer of labels from an annotated mesh to another mesh of the same building, by nearest surfaces."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from deux.contracts import SceneMesh
from deux.errors import DeuxError
from deux.mesh_files.mesh_parts import check_indices
from deux.mesh_files.ply_elements import read_ply_elements
from deux.mesh_files.ply_file import ply_triangles

SPACING = 0.1  # metres between the sample points of a labelled surface
VOTE_SPACING = 0.3  # metres between the points of a face that vote for its label
REACH = 0.2  # metres; greatest distance between a scan and its annotation

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class LabelledSurface:
    """Points on the annotated surfaces of a scene.

    Args:
        points: N x 3, metres, Y-up.
        labels: N int32, index into `names`, -1 = unlabelled.
        objects: N int32, number of the object, -1 = none.
        names: names of the labels, such as "chair".
    """

    points: np.ndarray
    labels: np.ndarray
    objects: np.ndarray
    names: tuple[str, ...]

    def label(self, mesh: SceneMesh, scene: str) -> SceneMesh:
        """Label a mesh: each face gets the label and object of the nearest points.

        Large faces are sampled at several points, of which the majority decides. Faces farther than `REACH` from every
        labelled point stay unlabelled; a warning is logged if most do.

        Args:
            mesh: a mesh of the same building in the same position.
            scene: the scene's name, for the warning.
        """
        owner, weights = surface_samples(mesh.triangles, VOTE_SPACING)
        places = np.einsum("pk,pkd->pd", weights, mesh.triangles[owner]) + mesh.origin
        distance, nearest = cKDTree(self.points).query(places, distance_upper_bound=REACH, workers=-1)
        near = np.isfinite(distance)
        faces, points = _majority(owner[near], nearest[near], self.labels, self.objects)
        if len(faces) < 0.5 * len(mesh.faces):
            log.warning(
                "%s: %.0f %% of its faces are farther than %.1f m from the labelled surfaces of its annotation and "
                "stay unlabelled: the two files may belong to different scenes.",
                scene,
                100 * (1 - len(faces) / len(mesh.faces)),
                REACH,
            )
        face_label = np.full(len(mesh.faces), -1, np.int32)
        face_object = face_label.copy()
        face_label[faces], face_object[faces] = self.labels[points], self.objects[points]
        return replace(mesh, face_label=face_label, face_object=face_object, label_names=self.names)


def _majority(
    faces: np.ndarray, points: np.ndarray, labels: np.ndarray, objects: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Find the label and object with most votes for each face.

    Args:
        faces: V, the face of each vote.
        points: V, the labelled point of each vote.
        labels: N, the label of each point.
        objects: N, the object of each point.

    Returns:
        The faces with votes, and for each a point with the chosen label and object.
    """
    label, number = labels[points], objects[points]
    order = np.lexsort((number, label, faces))
    face, label, number = faces[order], label[order], number[order]
    new = np.ones(len(face), bool)
    new[1:] = (face[1:] != face[:-1]) | (label[1:] != label[:-1]) | (number[1:] != number[:-1])
    first = np.flatnonzero(new)
    votes = np.diff(first, append=len(face))
    ranked = np.lexsort((votes, face[first]))  # the group with most votes is the last of each face
    last = np.append(np.diff(face[first][ranked]) != 0, True)[: len(ranked)]
    chosen = first[ranked[last]]
    return face[chosen], points[order[chosen]]


def surface_samples(triangles: np.ndarray, spacing: float = SPACING) -> tuple[np.ndarray, np.ndarray]:
    """Sample points on triangles: the centroids of n x n equal parts of each, with edges of at most `spacing`.

    Args:
        triangles: F x 3 x 3, metres.
        spacing: metres.

    Returns:
        P, the triangle of each point, and P x 3, its barycentric coordinates; the points are
        `np.einsum("pk,pkd->pd", weights, triangles[owner])`.
    """
    edges = np.linalg.norm(triangles - np.roll(triangles, 1, axis=1), axis=2).max(axis=1)
    pieces = np.clip(np.ceil(edges / spacing), 1, 1000).astype(np.int64)
    owners, weights = [], []
    for number in np.unique(pieces):
        same = np.flatnonzero(pieces == number)
        i, j = np.meshgrid(np.arange(number), np.arange(number), indexing="ij")
        upright, turned = i + j < number, i + j < number - 1  # parts, and parts rotated by 180 degrees between them
        b = np.concatenate([i[upright] + 1 / 3, i[turned] + 2 / 3]) / number
        c = np.concatenate([j[upright] + 1 / 3, j[turned] + 2 / 3]) / number
        owners.append(np.repeat(same, len(b)))
        weights.append(np.tile(np.stack([1 - b - c, b, c], axis=1), (len(same), 1)))
    return np.concatenate(owners), np.concatenate(weights)


def labelled_surface(
    triangles: np.ndarray, face_label: np.ndarray, face_object: np.ndarray, names: tuple[str, ...]
) -> LabelledSurface:
    """Sample the surface of a mesh that has one label and one object for each face.

    Args:
        triangles: F x 3 x 3, metres, Y-up.
        face_label: F, index into `names`, -1 = unlabelled.
        face_object: F, number of the object, -1 = none.
        names: names of the labels.
    """
    owner, weights = surface_samples(triangles)
    points = np.einsum("pk,pkd->pd", weights, triangles[owner])
    return LabelledSurface(points, face_label[owner].astype(np.int32), face_object[owner].astype(np.int32), names)


def look_up(mapping: Mapping[int, int], keys: np.ndarray) -> np.ndarray:
    """The value of each key, int64 of the keys' shape; -1 for keys that are not in the mapping."""
    known = np.array(sorted(mapping), np.int64)
    values = np.array([mapping[key] for key in known.tolist()], np.int64)
    if len(known) == 0:
        return np.full(keys.shape, -1)
    place = np.minimum(np.searchsorted(known, keys), len(known) - 1)
    return np.where(known[place] == keys, values[place], -1)


def read_annotated_ply(path: Path) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Read a Z-up .ply file whose faces have further properties; polygons are triangulated.

    Args:
        path: a .ply file.

    Returns:
        F x 3 x 3 float64, the triangles in metres, Y-up, and the other properties of the faces, F each, by name.

    Raises:
        DeuxError: the file cannot be read or has no faces.
    """
    elements = read_ply_elements(path)
    index, _, owner = ply_triangles(elements)
    if len(index) == 0:
        raise DeuxError(f"{path} contains no faces: it is not an annotated mesh.")
    vertex = elements["vertex"]
    check_indices(index, len(vertex["x"]), path)
    vertices = np.stack([np.asarray(vertex[axis], np.float64) for axis in "xzy"], axis=1) * (1.0, 1.0, -1.0)
    numbers = {name: v[owner] for name, v in elements["face"].items() if isinstance(v, np.ndarray)}
    return vertices[index], numbers
