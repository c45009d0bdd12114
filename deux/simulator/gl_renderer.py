"""Rendering by rasterisation with moderngl, on a GPU if there is one."""

from __future__ import annotations

import copy
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from deux.contracts import SceneMesh
from deux.geometry.camera import Camera
from deux.scenes.ray_caster import RayCaster
from deux.simulator.gl_clusters import Frustum, likely_occluders
from deux.simulator.gl_context import load_moderngl
from deux.simulator.gl_scene import GLScene
from deux.simulator.gl_target import RenderTarget
from deux.simulator.renderers import RenderedImage

if TYPE_CHECKING:
    import moderngl

NEAR_PLANE = 0.05  # metres; nearer surfaces are clipped; a smaller value reduces the precision of the depth buffer
_AT_ONCE = 16  # images that are rendered before the first of them is read


class GLRenderer:
    """Renders a mesh by OpenGL. The context is created by the first call of `render`, in the calling process.

    Args:
        mesh: the scene's mesh.
        camera: the camera.
        caster: not used.

    Raises:
        DeuxError: moderngl is not installed.
    """

    def __init__(self, mesh: SceneMesh, camera: Camera, caster: RayCaster | None = None) -> None:
        load_moderngl()
        self._model = _Model(mesh)
        self._set_camera(camera)

    def another(self, camera: Camera) -> GLRenderer:
        """A renderer of the same mesh for another camera; it shares the OpenGL context and its objects."""
        renderer = copy.copy(self)
        renderer._set_camera(camera)
        return renderer

    def render(self, poses: np.ndarray, colors: bool = True, faces: bool = False) -> list[RenderedImage]:
        """Render from N x 4 x 4 camera-to-world matrices; reading an image overlaps with rendering others.

        Raises:
            DeuxError: the system's OpenGL libraries are missing, or this process was forked from one that uses them.
        """
        images: list[RenderedImage] = []
        scene = self._model.scene
        with scene.context as gl:
            for start in range(0, len(poses), _AT_ONCE):
                images += self._render(gl, scene, poses[start : start + _AT_ONCE], colors, faces)
        return images

    def __reduce__(self) -> tuple[type[GLRenderer], tuple[SceneMesh, Camera]]:
        return GLRenderer, (self._model.mesh, self.camera)

    def _set_camera(self, camera: Camera) -> None:
        self.camera = camera
        self._frustum = Frustum(camera)
        self._clip_from_camera = _projection(camera, self._model.mesh)
        self._targets: dict[tuple[bool, bool], list[RenderTarget]] = {}

    def _render(
        self, gl: moderngl.Context, scene: GLScene, poses: np.ndarray, colors: bool, faces: bool
    ) -> list[RenderedImage]:
        targets = self._targets.setdefault((colors, faces), [])
        targets += [RenderTarget(gl, self.camera, colors, faces) for _ in range(len(poses) - len(targets))]
        clusters = scene.clusters
        seen = [self._frustum.within(clusters, pose) for pose in poses]
        matrices = [self._clip_from_camera @ np.linalg.inv(pose) for pose in poses]
        gl.enable_only(gl.DEPTH_TEST)
        if scene.context.on_cpu:
            # On the CPU, occlusion culling costs less than processing the vertices and pixels of hidden surfaces.
            likely = [likely_occluders(clusters, numbers) for numbers in seen]
            scene.draw(targets, matrices, [numbers[first] for numbers, first in zip(seen, likely, strict=True)])
            seen = [
                self._frustum.not_hidden(clusters, numbers[~first], pose, target.depth())
                for numbers, first, pose, target in zip(seen, likely, poses, targets, strict=False)
            ]
        scene.draw(targets, matrices, seen, new=not scene.context.on_cpu)
        return [target.read(self.camera, clusters.order) for target in targets[: len(poses)]]


class _Model:
    """A mesh and its OpenGL objects, shared by all cameras; these are created on first use."""

    def __init__(self, mesh: SceneMesh) -> None:
        self.mesh = mesh

    @cached_property
    def scene(self) -> GLScene:
        return GLScene(self.mesh)


def _projection(camera: Camera, mesh: SceneMesh) -> np.ndarray:
    """The 4 x 4 matrix from camera axes to clip space, whose y points down like the rows of images."""
    near = NEAR_PLANE
    far = max(camera.max_depth, float(np.linalg.norm(np.diff(mesh.bounds, axis=0)))) + 1.0
    x, y = 2 * camera.focal_length / camera.width, 2 * camera.focal_length / camera.height
    z, w = (far + near) / (far - near), -2 * far * near / (far - near)
    return np.array([[x, 0, 0, 0], [0, y, 0, 0], [0, 0, z, w], [0, 0, 1.0, 0]])
