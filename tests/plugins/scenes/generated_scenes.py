"""Measurements of generated scenes that the tests of flats and of houses share."""

import hashlib

import numpy as np

from deux.contracts import Scene
from deux.geometry.grid import FreeSpace
from deux.scenes.ray_caster import Hits, RayCaster

Rays = tuple[np.ndarray, np.ndarray]
"""Origins and unit directions, N x 3 each."""

STRUCTURE = frozenset({"wall", "floor", "ceiling", "door frame", "door", "window"})
"""The labels that belong to the building; all others are furniture."""


def digest(scene: Scene) -> str:
    """SHA-256 of all that is drawn of a scene."""
    mesh = scene.mesh
    total = hashlib.sha256()
    for array in (mesh.vertices, mesh.faces, mesh.uv, mesh.face_material, mesh.face_label, mesh.vertex_colors):
        total.update(np.ascontiguousarray(array).tobytes())
    for material in mesh.materials:
        total.update(repr((material.name, material.color)).encode())
        total.update(material.texture.tobytes())
    return total.hexdigest()


def normals(scene: Scene) -> np.ndarray:
    corners = scene.mesh.triangles.astype(np.float64)
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return cross / np.linalg.norm(cross, axis=1, keepdims=True)


def rays_from_the_floor(space: FreeSpace, count: int = 20_000) -> Rays:
    """Rays in all directions from the robot's camera, anywhere on the free floor."""
    rng = np.random.default_rng(0)
    cells = np.argwhere(space.free)[rng.integers(space.free.sum(), size=count)]
    x = space.frame.origin_x + (cells[:, 1] + 0.5) * space.frame.resolution
    z = space.frame.origin_z + (cells[:, 0] + 0.5) * space.frame.resolution
    directions = rng.normal(size=(len(cells), 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return np.stack([x, np.full(x.shape, 1.25), z], axis=1), directions


def seen_from_behind(scene: Scene, rays: Rays, hits: Hits) -> float:
    """Fraction of the rays that hit the back of a face."""
    return float(((normals(scene)[hits.face] * rays[1]).sum(axis=1) > 1e-6).mean())


def sharing_a_plane(scene: Scene, caster: RayCaster, rays: Rays, hits: Hits) -> float:
    """Fraction of the visible points where faces of two labels lie in one plane.

    Looking straight at a visible point from 5 mm away must show the same face again.
    """
    outward, back_off = normals(scene)[hits.face], 5e-3
    points = rays[0] + rays[1] * hits.distance[:, None]
    again = caster.cast(points + outward * back_off, -outward)
    other = (again.face >= 0) & (again.face // 2 != hits.face // 2)
    level = np.abs(again.distance - back_off) < 2e-4
    parallel = (normals(scene)[again.face] * outward).sum(axis=1) > 0.999
    # A point on the edge between two quadrilaterals of one plane may be given to either.
    seam = np.abs(hits.barycentric).min(axis=1) < 1e-3
    labels = scene.mesh.face_label
    return float((other & level & parallel & ~seam & (labels[again.face] != labels[hits.face])).mean())
