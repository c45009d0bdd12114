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
    """A scene whose faces are split; it looks the same.

    Args:
        name: the scene's name.
        original: the scene as it is.
        triangles: least number of triangles.
    """

    original: SceneReference
    triangles: int

    @property
    def identity(self) -> str:
        """Identity of the original, and the number of triangles."""
        return f"{self.original.identity}:{self.triangles}"

    def load(self) -> Scene:
        """Load the original and split its faces."""
        scene = self.original.load()
        return replace(scene, mesh=split_faces(scene.mesh, self.triangles), identity=self.identity)


def flats(count: int) -> tuple[SceneReference, ...]:
    """Generated flats, always the same ones."""
    return _training_scenes({"name": "apartments", "train": count, "validation": 0, "test": 0})


def scene_in(file: Path) -> SceneReference:
    """The scene in a mesh file.

    Raises:
        DeuxError: the file is missing, or of no known kind.
    """
    return _training_scenes({"name": "files", "train": str(file)})[0]


def default_simulation(size: int) -> Simulation:
    """Makes the built-in simulator with its default options, the images `size` pixels high and wide."""
    chosen = registry().choose("simulators", {"name": BUILT_IN_SIMULATOR})
    return Simulation(Camera(size, size), Robot(), chosen)


def usable_simulators(scene: SceneReference, camera: Camera) -> tuple[dict[str, Simulator], dict[str, str]]:
    """A simulator of the scene for each renderer that works here.

    Returns:
        The simulators by renderer, and why each of the others is left out.
    """
    simulators: dict[str, Simulator] = {}
    left_out: dict[str, str] = {}
    for name, choice in renderers().items():
        try:
            simulator = Simulation(camera, Robot(), choice).make(scene)
            simulator.observe(COLOR, free_poses(simulator, 1, seed=0))  # loads the renderer's libraries
        except DeuxError as error:
            left_out[name] = str(error)
        else:
            simulators[name] = simulator
    return simulators, left_out


def free_poses(simulator: Simulator, count: int, seed: int) -> np.ndarray:
    """Camera poses at random places of the main floor, with random headings; `count` x 4 x 4 camera-to-world."""
    space = simulator.free_space()
    height = space.floor_height + simulator.robot.camera_height
    starts = random_starts(space, count, np.random.default_rng(seed))
    return np.stack([camera_pose(x, height, z, yaw) for x, z, yaw in starts])


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


def _training_scenes(chosen: dict[str, Any]) -> tuple[SceneReference, ...]:
    """The training scenes of a source."""
    source: SceneSource = registry().choose("scenes", chosen).create()
    return source.splits().train


def _quarters(corners: np.ndarray) -> np.ndarray:
    """The four parts of each of F faces, in the same orientation: F x 3 x C to 4 F x 3 x C."""
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
    parts = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
    return np.stack([np.stack(part, axis=1) for part in parts], axis=1).reshape(-1, 3, corners.shape[-1])
