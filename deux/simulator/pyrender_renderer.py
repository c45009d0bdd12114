"""Rendering by rasterisation with pyrender, on a GPU if there is one."""

from __future__ import annotations

from typing import Any

import numpy as np

from deux.contracts import SceneMesh
from deux.geometry.camera import Camera
from deux.scenes.ray_caster import RayCaster
from deux.simulator.egl_context import EGLContext, load_pyrender
from deux.simulator.renderers import RenderedImage

NEAR_PLANE = 0.05  # metres; nearer surfaces are clipped; a smaller value reduces the precision of the depth
_OPENGL_FROM_OPENCV = np.diag([1.0, -1.0, -1.0, 1.0])  # camera axes: OpenGL's y points up, its z backwards


class PyrenderRenderer:
    """Renders a mesh by OpenGL. The context is created by the first call of `render`, in the calling thread.

    Args:
        mesh: the scene's mesh.
        camera: the camera.
        caster: not used.

    Raises:
        DeuxError: the system's OpenGL libraries are missing.
    """

    def __init__(self, mesh: SceneMesh, camera: Camera, caster: RayCaster | None = None) -> None:
        pyrender = load_pyrender()
        self.camera = camera
        self._mesh = mesh
        self._context: EGLContext | None = None
        self._surfaces = _colored_surfaces(mesh)
        self._face_surface: Any = None
        self._scene = pyrender.Scene(bg_color=[0.0, 0.0, 0.0, 1.0])
        self._scene.add(self._surfaces)
        diagonal = float(np.linalg.norm(np.diff(mesh.bounds, axis=0)))
        lens = pyrender.IntrinsicsCamera(
            camera.focal_length,
            camera.focal_length,
            # In OpenGL the origin is the edge of the first pixel, not its centre.
            camera.width / 2,
            camera.height / 2,
            znear=NEAR_PLANE,
            zfar=max(camera.max_depth, diagonal) + 1.0,
        )
        self._lens = self._scene.add(lens)

    def another(self, camera: Camera) -> PyrenderRenderer:
        """A renderer of the same mesh for another camera, with a separate OpenGL context and textures."""
        return PyrenderRenderer(self._mesh, camera)

    def render(self, poses: np.ndarray, colors: bool = True, faces: bool = False) -> list[RenderedImage]:
        """Render from N x 4 x 4 camera-to-world matrices; without `colors`, colours are rendered but not returned."""
        return [self._render(pose, colors, faces) for pose in poses]

    def _render(self, pose: np.ndarray, colors: bool, faces: bool) -> RenderedImage:
        if self._context is None:
            self._context = EGLContext(self.camera.width, self.camera.height)
        self._scene.set_pose(self._lens, pose @ _OPENGL_FROM_OPENCV)
        rgb, depth = self._context.render(self._scene)
        depth[(depth < self.camera.min_depth) | (depth > self.camera.max_depth)] = 0.0
        return RenderedImage(depth, rgb if colors else None, self._draw_faces() if faces else None)

    def _draw_faces(self) -> np.ndarray:
        """Render the scene again from the current pose with a unique colour for each face."""
        assert self._context is not None
        if self._face_surface is None:
            self._face_surface = _face_surface(self._mesh)
            self._scene.add(self._face_surface)
        self._surfaces.is_visible, self._face_surface.is_visible = False, True
        code, _ = self._context.render(self._scene)
        self._surfaces.is_visible, self._face_surface.is_visible = True, False
        return code.astype(np.int32) @ np.array([1, 256, 65536], dtype=np.int32) - 1


def _colored_surfaces(mesh: SceneMesh) -> Any:
    """The mesh in one piece for each texture, to save draw calls and copies of textures."""
    pyrender = load_pyrender()
    textures = {id(material.texture): material.texture for material in mesh.materials}
    texture_of_face = np.array([id(material.texture) for material in mesh.materials])[mesh.face_material]
    base_color = np.array([material.color for material in mesh.materials], np.float32) / 255.0
    pieces = []
    for key, texture in textures.items():
        faces = np.flatnonzero(texture_of_face == key)
        if len(faces) == 0:
            continue
        color = np.repeat(base_color[mesh.face_material[faces]][:, None], 3, axis=1)
        if mesh.vertex_colors is not None:
            color = color * (mesh.vertex_colors[mesh.faces[faces]] / np.float32(255.0))
        source = None if texture is None else pyrender.Texture(source=texture, source_channels="RGB")
        pieces.append(
            pyrender.Primitive(
                positions=mesh.triangles[faces].reshape(-1, 3),
                texcoord_0=None if texture is None else mesh.uv[faces].reshape(-1, 2),
                color_0=color.reshape(-1, 3),
                material=pyrender.MetallicRoughnessMaterial(baseColorTexture=source),
            )
        )
    return pyrender.Mesh(pieces)


def _face_surface(mesh: SceneMesh) -> Any:
    """The mesh in one piece, with the index of each face + 1 as its colour, in base 256."""
    pyrender = load_pyrender()
    number = np.repeat(np.arange(1, len(mesh.faces) + 1), 3)
    code = np.stack([number & 255, number >> 8 & 255, number >> 16 & 255], axis=-1)
    return pyrender.Mesh([pyrender.Primitive(positions=mesh.triangles.reshape(-1, 3), color_0=code)])
