"""Scenes, simulators and camera poses for the benchmarks."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from deux.bench.installed_plugins import BUILT_IN_SIMULATOR, renderers
from deux.contracts import COLOR, Robot, Scene, SceneMesh, SceneReference, SceneSource, Simulator
from deux.errors import DeuxError
from deux.geometry.camera import Camera
from deux.geometry.poses import camera_pose
from deux.registry import registry
from deux.simulator.simulation import Simulation
from deux.simulator.starts import random_starts


@dataclass(frozen=True)
class FinerScene(SceneReference):
    """A scene with subdivided faces and unchanged appearance.

    Args:
        name: name of the scene.
        original: the scene to subdivide.
        triangles: minimum number of triangles.
    """

    original: SceneReference
    triangles: int

    @property
    def identity(self) -> str:
        """Identity of the original scene and the number of triangles."""
        return f"{self.original.identity}:{self.triangles}"

    def load(self) -> Scene:
        """Load the original scene and subdivide its faces."""
        scene = self.original.load()
        return replace(scene, mesh=split_faces(scene.mesh, self.triangles), identity=self.identity)


def flats(count: int) -> tuple[SceneReference, ...]:
    """Create references of `count` generated flats; they are the same in each call."""
    return _training_scenes({"name": "apartments", "train": count, "validation": 0, "test": 0})


def scene_in(file: Path) -> SceneReference:
    """Create a reference of the scene in a mesh file.

    Raises:
        DeuxError: the file is missing or its format is unknown.
    """
    return _training_scenes({"name": "files", "train": str(file)})[0]


def default_simulation(size: int) -> Simulation:
    """Create the built-in simulation with default options and images of `size` x `size` pixels."""
    chosen = registry().choose("simulators", {"name": BUILT_IN_SIMULATOR})
    return Simulation(Camera(size, size), Robot(), chosen)


def usable_simulators(scene: SceneReference, camera: Camera) -> tuple[dict[str, Simulator], dict[str, str]]:
    """Create a simulator of the scene for each renderer that works on this machine.

    Returns:
        The simulators by renderer, and the error messages of the renderers that do not work.
    """
    simulators: dict[str, Simulator] = {}
    left_out: dict[str, str] = {}
    for name, choice in renderers().items():
        try:
            simulator = Simulation(camera, Robot(), choice).make(scene)
            simulator.observe(COLOR, free_poses(simulator, 1, seed=0))  # fails if the renderer's libraries are missing
        except DeuxError as error:
            left_out[name] = str(error)
        else:
            simulators[name] = simulator
    return simulators, left_out


def free_poses(simulator: Simulator, count: int, seed: int) -> np.ndarray:
    """Random camera-to-world poses in the free space of the main floor; `count` x 4 x 4."""
    space = simulator.free_space()
    height = space.floor_height + simulator.robot.camera_height
    starts = random_starts(space, count, np.random.default_rng(seed))
    return np.stack([camera_pose(x, height, z, yaw) for x, z, yaw in starts])


def split_faces(mesh: SceneMesh, triangles: int) -> SceneMesh:
    """Subdivide the largest faces into four each until the mesh has enough triangles; its appearance does not change.

    Args:
        mesh: the mesh.
        triangles: minimum number of triangles. The result has at most two more, or the number of the input.
    """
    # Position, texture coordinates and colour of each corner: F x 3 x 8.
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


def _training_scenes(chosen: dict[str, Any]) -> tuple[SceneReference, ...]:
    """Training scenes of a scene source."""
    source: SceneSource = registry().choose("scenes", chosen).create()
    return source.splits().train


def _quarters(corners: np.ndarray) -> np.ndarray:
    """Split faces at the midpoints of their edges, keeping their orientation: F x 3 x C to 4F x 3 x C."""
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
    parts = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
    return np.stack([np.stack(part, axis=1) for part in parts], axis=1).reshape(-1, 3, corners.shape[-1])
