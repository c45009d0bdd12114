"""Rendering by rasterisation with moderngl, on the graphics card where there is one."""

from __future__ import annotations

import copy
from functools import cached_property
from typing import TYPE_CHECKING

import cv2
import numpy as np

from deux.compilation import compiled
from deux.contracts import SceneMesh
from deux.geometry.camera import Camera
from deux.scenes.ray_caster import RayCaster
from deux.simulator.gl_clusters import Frustum
from deux.simulator.gl_context import load_moderngl
from deux.simulator.gl_scene import GLScene
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
            DeuxError: the system's OpenGL libraries are missing, or this process was forked from one that has a context.
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
        self._targets: dict[tuple[bool, bool], list[_Target]] = {}

    def _render(
        self, gl: moderngl.Context, scene: GLScene, poses: np.ndarray, colors: bool, faces: bool
    ) -> list[RenderedImage]:
        targets = self._targets.setdefault((colors, faces), [])
        targets += [_Target(gl, self.camera, colors, faces) for _ in range(len(poses) - len(targets))]
        seen = [scene.commands(self._frustum.clusters(scene.clusters, pose)) for pose in poses]
        commands = gl.buffer(np.concatenate(seen).tobytes() or bytes(1))
        program, mesh = scene.program(colors, faces)
        gl.enable_only(gl.DEPTH_TEST)
        first = 0
        for pose, target, own in zip(poses, targets, seen, strict=False):
            clip_from_world = self._clip_from_camera @ np.linalg.inv(pose)
            program["clip_from_world"].write(clip_from_world.T.astype(np.float32).tobytes())
            target.frame.use()
            target.frame.clear(depth=1.0)
            if len(own):
                mesh.render_indirect(commands, count=len(own), first=first)
            first += len(own)
        return [target.read(self.camera, scene.clusters.order) for target in targets[: len(poses)]]


class _Model:
    """A mesh, and what OpenGL needs of it, for all cameras that see it; made on first use."""

    def __init__(self, mesh: SceneMesh) -> None:
        self.mesh = mesh

    @cached_property
    def scene(self) -> GLScene:
        return GLScene(self.mesh)


class _Target:
    """What one image is drawn into: depth, and colours and numbers of faces if asked for."""

    def __init__(self, gl: moderngl.Context, camera: Camera, colors: bool, faces: bool) -> None:
        size = camera.width, camera.height
        self._depth = gl.texture(size, 1, dtype="f4")
        self._color = gl.texture(size, 4) if colors else None
        self._face = gl.texture(size, 1, dtype="i4") if faces else None
        attachments = [texture for texture in (self._depth, self._color, self._face) if texture is not None]
        self.frame = gl.framebuffer(attachments, gl.depth_renderbuffer(size))

    def read(self, camera: Camera, face_order: np.ndarray) -> RenderedImage:
        """Wait until the image is drawn and copy it to arrays of its own."""
        shape = camera.height, camera.width
        depth = np.empty(shape, np.float32)
        self._depth.read_into(depth)
        rgb = face = None
        if self._color is not None:
            rgba = np.empty((*shape, 4), np.uint8)
            self._color.read_into(rgba)
            rgb = cv2.cvtColor(rgba, cv2.COLOR_RGBA2RGB)  # fifty times faster than slicing
        if self._face is not None:
            place = np.empty(shape, np.int32)
            self._face.read_into(place)
            face = np.full(shape, -1, np.int32)
            drawn = depth > 0.0
            face[drawn] = face_order[place[drawn]]
        _clear_out_of_range(depth, camera.min_depth, camera.max_depth)
        return RenderedImage(depth, rgb, face)


def _projection(camera: Camera, mesh: SceneMesh) -> np.ndarray:
    """The matrix from camera axes to clip space, whose y points down as the image's rows do."""
    near = NEAR_PLANE
    far = max(camera.max_depth, float(np.linalg.norm(np.diff(mesh.bounds, axis=0)))) + 1.0
    x, y = 2 * camera.focal_length / camera.width, 2 * camera.focal_length / camera.height
    z, w = (far + near) / (far - near), -2 * far * near / (far - near)
    return np.array([[x, 0, 0, 0], [0, y, 0, 0], [0, 0, z, w], [0, 0, 1.0, 0]])


@compiled(nogil=True)
def _clear_out_of_range(depth: np.ndarray, least: float, most: float) -> None:
    for row in range(depth.shape[0]):
        for column in range(depth.shape[1]):
            if depth[row, column] < least or depth[row, column] > most:
                depth[row, column] = 0.0
