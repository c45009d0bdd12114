"""The scenes that are measured in."""

from dataclasses import dataclass, replace

import numpy as np

from deux.contracts import Robot, Scene, SceneMesh
from deux.geometry.poses import camera_pose
from deux.scenes.free_space import free_space
from deux.scenes.sources import ApartmentReference, SceneReference
from deux.simulator.starts import random_starts


@dataclass(frozen=True)
class BenchScene:
    """A scene, made finer if it is to have more triangles.

    Args:
        reference: the scene.
        triangles: least number of triangles; None leaves them as they are.
    """

    reference: SceneReference
    triangles: int | None = None

    def load(self) -> Scene:
        """Make or read the scene."""
        scene = self.reference.load()
        return scene if self.triangles is None else replace(scene, mesh=split_faces(scene.mesh, self.triangles))


def flat(seed: int) -> ApartmentReference:
    """A generated flat."""
    return ApartmentReference(f"apartment_{seed:06d}", seed)


def free_poses(scene: Scene, robot: Robot, count: int, seed: int) -> list[np.ndarray]:
    """Camera poses at random places on the free floor, with random headings; each 4 x 4 camera-to-world."""
    space = free_space(scene.mesh, scene.floor_height, robot)
    height = scene.floor_height + robot.camera_height
    starts = random_starts(space, count, np.random.default_rng(seed))
    return [camera_pose(x, height, z, yaw) for x, z, yaw in starts]


def split_faces(mesh: SceneMesh, triangles: int) -> SceneMesh:
    """Split the largest faces into four at the middles of their edges until there are enough; nothing looks different.

    Args:
        mesh: the mesh.
        triangles: number of triangles that the result has at least; fewer than 3 more.
    """
    # Position, texture coordinates and colour of each corner, F x 3 x 8.
    colors = np.zeros((len(mesh.vertices), 3), np.uint8) if mesh.vertex_colors is None else mesh.vertex_colors
    corners = np.concatenate([mesh.triangles, mesh.uv, colors[mesh.faces]], axis=-1).astype(np.float32)
    parent = np.arange(len(mesh.faces))
    while len(corners) < triangles:
        edges = corners[:, 1:, :3] - corners[:, :1, :3]
        area = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1)
        count = min(len(corners), -(-(triangles - len(corners)) // 3))
        order = np.argsort(-area, kind="stable")
        split, whole = order[:count], order[count:]
        corners = np.concatenate([corners[whole], _quarters(corners[split])])
        parent = np.concatenate([parent[whole], np.repeat(parent[split], 4)])
    points = corners.reshape(-1, corners.shape[-1])
    return replace(
        mesh,
        vertices=np.ascontiguousarray(points[:, :3]),
        faces=np.arange(len(points), dtype=np.int32).reshape(-1, 3),
        uv=np.ascontiguousarray(corners[..., 3:5]),
        face_material=mesh.face_material[parent],
        face_label=mesh.face_label[parent],
        vertex_colors=None if mesh.vertex_colors is None else np.rint(points[:, 5:]).astype(np.uint8),
    )


def _quarters(corners: np.ndarray) -> np.ndarray:
    """The four parts of each of F faces, in the same orientation: F x 3 x C to 4 F x 3 x C."""
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
    parts = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
    return np.stack([np.stack(part, axis=1) for part in parts], axis=1).reshape(-1, 3, corners.shape[-1])
