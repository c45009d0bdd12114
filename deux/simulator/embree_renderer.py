"""Rendering by ray casting with Embree on the CPU: exact depth, filtered textures, no system libraries."""

from __future__ import annotations

import copy
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from deux.compilation import compiled
from deux.contracts import SceneMesh
from deux.geometry.camera import Camera
from deux.scenes.ray_caster import Hits, RayCaster
from deux.simulator.renderers import RenderedImage
from deux.simulator.shading import Surfaces, prepare_surfaces, shade


class EmbreeRenderer:
    """Casts one ray through the centre of each pixel, and shades the surface that it hits.

    Args:
        mesh: the scene's mesh.
        camera: the camera.
        caster: a ray caster of `mesh` to reuse.
    """

    def __init__(self, mesh: SceneMesh, camera: Camera, caster: RayCaster | None = None) -> None:
        self._model = _Model(mesh, caster or RayCaster(mesh))
        self._set_camera(camera)

    def another(self, camera: Camera) -> EmbreeRenderer:
        """A renderer of the same mesh for another camera; it shares the ray caster and the textures."""
        renderer = copy.copy(self)
        renderer._set_camera(camera)
        return renderer

    def render(self, poses: np.ndarray, colors: bool = True, faces: bool = False) -> list[RenderedImage]:
        """Render from N x 4 x 4 camera-to-world matrices, one pose at a time (casting several at once is slower)."""
        return [self._render(pose, colors, faces) for pose in poses]

    def _set_camera(self, camera: Camera) -> None:
        self.camera = camera
        self._rays = camera.rays().reshape(-1, 3).astype(np.float32)

    def _render(self, pose: np.ndarray, colors: bool, faces: bool) -> RenderedImage:
        rotation, rays, hits = self._cast(pose)
        rgb = None
        if colors:
            pixel = np.float32(1.0 / self.camera.focal_length)
            right, down = rotation[:, 0] * pixel, rotation[:, 1] * pixel
            rgb = shade(hits.face, hits.barycentric, hits.distance, rays, right, down, self._model.surfaces)
            rgb = rgb.reshape(self.camera.height, self.camera.width, 3)
        depth = self._depth(hits)
        return RenderedImage(depth, rgb, hits.face.reshape(depth.shape) if faces else None)

    def _cast(self, pose: np.ndarray) -> tuple[np.ndarray, np.ndarray, Hits]:
        """The camera's rotation, its rays in the world, and what they hit."""
        rotation = np.ascontiguousarray(pose[:3, :3], dtype=np.float32)
        rays, origins = _world_rays(self._rays, rotation, pose[:3, 3].astype(np.float32))
        # The rays have a depth of 1, not a length of 1: their distance is the depth along the optical axis.
        return rotation, rays, self._model.caster.cast(origins, rays)

    def _depth(self, hits: Hits) -> np.ndarray:
        in_range = (hits.distance >= self.camera.min_depth) & (hits.distance <= self.camera.max_depth)
        depth = np.where(in_range, hits.distance, np.float32(0.0))
        return depth.reshape(self.camera.height, self.camera.width)


@dataclass
class _Model:
    """A mesh with its ray caster and surfaces, shared by all cameras; the surfaces are prepared on first use."""

    mesh: SceneMesh
    caster: RayCaster

    @cached_property
    def surfaces(self) -> Surfaces:
        return prepare_surfaces(self.mesh)


# Not `rays @ rotation.T`: after a product this small, BLAS threads keep spinning for long.
@compiled(nogil=True)
def _world_rays(rays: np.ndarray, rotation: np.ndarray, centre: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rotate camera rays, N x 3 float32, into the world; returns directions and origins (the centre N times)."""
    directions = np.empty_like(rays)
    origins = np.empty_like(rays)
    for i in range(len(rays)):
        for axis in range(3):
            directions[i, axis] = (
                rotation[axis, 0] * rays[i, 0] + rotation[axis, 1] * rays[i, 1] + rotation[axis, 2] * rays[i, 2]
            )
            origins[i, axis] = centre[axis]
    return directions, origins
