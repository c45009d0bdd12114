"""Ray casting against a mesh with Embree."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from embreex import rtcore_scene
from embreex.mesh_construction import TriangleMesh

from deux.contracts import SceneMesh

APART = 0.005  # metres; surfaces on a vertical ray that are nearer to each other count as one


@dataclass(frozen=True)
class Hits:
    """The first hit of each of N rays.

    Args:
        distance: N float32, in units of the direction's length; infinite if the ray hits nothing.
        face: N int32, index of the mesh's face, -1 if the ray hits nothing.
        barycentric: N x 2 float32, (u, v): the point is (1 - u - v) a + u b + v c of the face's corners a, b, c.
    """

    distance: np.ndarray
    face: np.ndarray
    barycentric: np.ndarray


class RayCaster:
    """Casts rays at a mesh. The bounding volume hierarchy is built at the first cast.

    A pickled copy contains only the mesh, and builds its own hierarchy.

    Args:
        mesh: the triangles; rays hit both of their sides.
    """

    def __init__(self, mesh: SceneMesh) -> None:
        self.mesh = mesh

    def cast(self, origins: np.ndarray, directions: np.ndarray) -> Hits:
        """Find the first hit of each ray.

        Args:
            origins: N x 3, metres.
            directions: N x 3, of any length. If their z is 1 in camera axes, the distance is the depth.
        """
        starts = np.ascontiguousarray(origins, dtype=np.float32)
        found = self._embree.run(starts, np.ascontiguousarray(directions, dtype=np.float32), output=1)
        face = found["primID"]
        distance = np.where(face >= 0, found["tfar"], np.float32(np.inf))
        return Hits(distance, face, np.stack([found["u"], found["v"]], axis=-1))

    def surfaces_below(self, points: np.ndarray, most: int = 64) -> tuple[np.ndarray, np.ndarray]:
        """Find all surfaces on the vertical through each point, from the highest downwards.

        Of surfaces within `APART` of each other only the highest is found.

        Args:
            points: N x 2, world x and z in metres.
            most: greatest number of surfaces on each vertical.

        Returns:
            K x N float64, world y of the surfaces, NaN if a vertical has fewer; and K x N int32, their faces, else -1.
        """
        top = float(self.mesh.bounds[1, 1]) + 1.0
        origins = np.stack([points[:, 0], np.full(len(points), top), points[:, 1]], axis=-1)
        active = np.arange(len(points))
        heights: list[np.ndarray] = []
        faces: list[np.ndarray] = []
        for _ in range(most):
            hits = self.cast(origins[active], np.broadcast_to(np.array([0.0, -1.0, 0.0]), (len(active), 3)))
            hit = hits.face >= 0
            active = active[hit]
            if not active.size:
                break
            height, face = np.full(len(points), np.nan), np.full(len(points), -1, np.int32)
            # Interpolated from the corners, which is exact on level surfaces, unlike the float32 distance.
            a, b, c = self.mesh.vertices[self.mesh.faces[hits.face[hit]], 1].astype(np.float64).T
            u, v = hits.barycentric[hit].T
            height[active] = a + u * (b - a) + v * (c - a)
            face[active] = hits.face[hit]
            heights.append(height)
            faces.append(face)
            origins[active, 1] = height[active] - APART
        return np.array(heights).reshape(-1, len(points)), np.array(faces, np.int32).reshape(-1, len(points))

    @cached_property
    def _embree(self) -> Any:
        scene = rtcore_scene.EmbreeScene()
        vertices = np.ascontiguousarray(self.mesh.vertices, dtype=np.float32)
        TriangleMesh(scene, vertices, np.ascontiguousarray(self.mesh.faces, dtype=np.int32))
        return scene

    def __getstate__(self) -> dict[str, SceneMesh]:
        return {"mesh": self.mesh}
