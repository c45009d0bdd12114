"""Rendering by rasterisation with moderngl, on the graphics card where there is one."""

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

NEAR_PLANE = 0.05  # metres; nearer surfaces are cut away, and the order of farther ones gets less sure as it shrinks
_AT_ONCE = 16  # images that are drawn before the first of them is read


class GLRenderer:
    """Draws a scene by OpenGL. The context is made by the first `render`, in the process that calls it.

    Args:
        mesh: what is drawn.
        camera: the camera that sees it.
        caster: not used, as OpenGL casts no rays.

    Raises:
        DeuxError: moderngl is not installed.
    """

    def __init__(self, mesh: SceneMesh, camera: Camera, caster: RayCaster | None = None) -> None:
        load_moderngl()
        self._model = _Model(mesh)
        self._set_camera(camera)

    def another(self, camera: Camera) -> GLRenderer:
        """A renderer of the same mesh as another camera sees it; the context and all that is in it are shared."""
        renderer = copy.copy(self)
        renderer._set_camera(camera)
        return renderer

    def render(self, poses: np.ndarray, colors: bool = True, faces: bool = False) -> list[RenderedImage]:
        """Render from N x 4 x 4 camera-to-world matrices; while one image is read, others are still drawn.

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
            # Vertices and hidden surfaces cost more there than to look what the nearest ones have left open.
            likely = [likely_occluders(clusters, numbers) for numbers in seen]
            scene.draw(targets, matrices, [numbers[first] for numbers, first in zip(seen, likely, strict=True)])
            seen = [
                self._frustum.not_hidden(clusters, numbers[~first], pose, target.depth())
                for numbers, first, pose, target in zip(seen, likely, poses, targets, strict=False)
            ]
        scene.draw(targets, matrices, seen, new=not scene.context.on_cpu)
        return [target.read(self.camera, clusters.order) for target in targets[: len(poses)]]


class _Model:
    """A mesh, and what OpenGL needs of it, for all cameras that see it; made on first use."""

    def __init__(self, mesh: SceneMesh) -> None:
        self.mesh = mesh

    @cached_property
    def scene(self) -> GLScene:
        return GLScene(self.mesh)


def _projection(camera: Camera, mesh: SceneMesh) -> np.ndarray:
    """The matrix from camera axes to clip space, whose y points down as the image's rows do."""
    near = NEAR_PLANE
    far = max(camera.max_depth, float(np.linalg.norm(np.diff(mesh.bounds, axis=0)))) + 1.0
    x, y = 2 * camera.focal_length / camera.width, 2 * camera.focal_length / camera.height
    z, w = (far + near) / (far - near), -2 * far * near / (far - near)
    return np.array([[x, 0, 0, 0], [0, y, 0, 0], [0, 0, z, w], [0, 0, 1.0, 0]])
