"""Rendering by ray casting on the CPU: exact depth, filtered textures, no system library."""

from functools import cached_property

import numpy as np
from numba import njit

from deux.geometry.camera import Camera
from deux.scenes.ray_caster import Hits, RayCaster
from deux.scenes.scene import Scene
from deux.simulator.renderers import RenderedImage
from deux.simulator.shading import Surfaces, prepare_surfaces, shade


class EmbreeRenderer:
    """Casts one ray through each pixel's centre with Embree and looks up the colour of what it hits.

    Args:
        scene: what is drawn.
        camera: the camera that sees it.
    """

    def __init__(self, scene: Scene, camera: Camera) -> None:
        self.camera = camera
        self._caster = RayCaster(scene.mesh)
        self._face_label = np.append(scene.mesh.face_label, -1).astype(np.int32)  # face -1, "none", has label -1
        self._mesh = scene.mesh
        self._rays = camera.rays().reshape(-1, 3).astype(np.float32)

    def render(self, pose: np.ndarray, labels: bool = True) -> RenderedImage:
        """Render from a 4 x 4 camera-to-world matrix (OpenCV camera axes, metres)."""
        rotation, rays, hits = self._cast(pose)
        pixel = np.float32(1.0 / self.camera.focal_length)
        right, down = rotation[:, 0] * pixel, rotation[:, 1] * pixel
        rgb = shade(hits.face, hits.barycentric, hits.distance, rays, right, down, self._surfaces)
        rgb = rgb.reshape(self.camera.height, self.camera.width, 3)
        return RenderedImage(rgb, self._depth(hits), self._labels(hits) if labels else None)

    def depth(self, pose: np.ndarray) -> np.ndarray:
        """The depth alone, H x W float32, as `render` gives it; the textures are not touched."""
        return self._depth(self._cast(pose)[2])

    def labelled_depth(self, pose: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The depth and the labels, H x W int32, as `render` gives them; the textures are not touched."""
        hits = self._cast(pose)[2]
        return self._depth(hits), self._labels(hits)

    def faces(self, pose: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The depth, and the mesh's face that each pixel shows: H x W int32, -1 where there is none in range."""
        hits = self._cast(pose)[2]
        depth = self._depth(hits)
        return depth, np.where(depth > 0.0, hits.face.reshape(depth.shape), -1)

    @cached_property
    def _surfaces(self) -> Surfaces:
        return prepare_surfaces(self._mesh)

    def _cast(self, pose: np.ndarray) -> tuple[np.ndarray, np.ndarray, Hits]:
        """The camera's rotation, its rays in the world, and what they hit."""
        rotation = np.ascontiguousarray(pose[:3, :3], dtype=np.float32)
        rays, origins = _world_rays(self._rays, rotation, pose[:3, 3].astype(np.float32))
        # The camera's rays are one metre deep, not one metre long: the distance is the depth along the optical axis.
        return rotation, rays, self._caster.cast(origins, rays)

    def _labels(self, hits: Hits) -> np.ndarray:
        return self._face_label[hits.face].reshape(self.camera.height, self.camera.width)

    def _depth(self, hits: Hits) -> np.ndarray:
        in_range = (hits.distance >= self.camera.min_depth) & (hits.distance <= self.camera.max_depth)
        depth = np.where(in_range, hits.distance, np.float32(0.0))
        return depth.reshape(self.camera.height, self.camera.width)


# By hand and not `rays @ rotation.T`: BLAS keeps its threads spinning for long after so small a product.
@njit(cache=True, nogil=True)
def _world_rays(rays: np.ndarray, rotation: np.ndarray, centre: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Turn camera rays (N x 3 float32) into the world; also their origins, the camera's centre N times."""
    directions = np.empty_like(rays)
    origins = np.empty_like(rays)
    for i in range(len(rays)):
        for axis in range(3):
            directions[i, axis] = (
                rotation[axis, 0] * rays[i, 0] + rotation[axis, 1] * rays[i, 1] + rotation[axis, 2] * rays[i, 2]
            )
            origins[i, axis] = centre[axis]
    return directions, origins
