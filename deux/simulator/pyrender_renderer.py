"""Rendering by rasterisation with pyrender, on the graphics card where there is one."""

from typing import Any

import numpy as np

from deux.geometry.camera import Camera
from deux.scenes.mesh import SceneMesh
from deux.scenes.scene import Scene
from deux.simulator.egl_context import EGLContext, load_pyrender
from deux.simulator.renderers import RenderedImage

NEAR_PLANE = 0.05  # metres; nearer surfaces are cut away, and depth gets coarser in proportion as it shrinks
_OPENGL_FROM_OPENCV = np.diag([1.0, -1.0, -1.0, 1.0])  # camera axes: OpenGL's y points up, its z backwards


class PyrenderRenderer:
    """Draws a scene by OpenGL. The context is made by the first `render`, in the process and thread that calls it.

    Args:
        scene: what is drawn.
        camera: the camera that sees it.

    Raises:
        DeuxError: the system's OpenGL libraries are missing.
    """

    def __init__(self, scene: Scene, camera: Camera) -> None:
        pyrender = load_pyrender()
        self.camera = camera
        self._mesh = scene.mesh
        self._context: EGLContext | None = None
        self._surfaces = _colored_surfaces(scene.mesh)
        self._label_surface: Any = None
        self._scene = pyrender.Scene(bg_color=[0.0, 0.0, 0.0, 1.0])
        self._scene.add(self._surfaces)
        diagonal = float(np.linalg.norm(np.diff(scene.mesh.bounds, axis=0)))
        lens = pyrender.IntrinsicsCamera(
            camera.focal_length,
            camera.focal_length,
            # OpenGL counts from the edge of the first pixel, not from its centre.
            camera.width / 2,
            camera.height / 2,
            znear=NEAR_PLANE,
            zfar=max(camera.max_depth, diagonal) + 1.0,
        )
        self._lens = self._scene.add(lens)

    def render(self, pose: np.ndarray, labels: bool = True) -> RenderedImage:
        """Render from a 4 x 4 camera-to-world matrix (OpenCV camera axes, metres)."""
        if self._context is None:
            self._context = EGLContext(self.camera.width, self.camera.height)
        self._scene.set_pose(self._lens, pose @ _OPENGL_FROM_OPENCV)
        rgb, depth = self._context.render(self._scene)
        depth[(depth < self.camera.min_depth) | (depth > self.camera.max_depth)] = 0.0
        return RenderedImage(rgb, depth, self._draw_labels() if labels else None)

    def depth(self, pose: np.ndarray) -> np.ndarray:
        """The depth alone, H x W float32; OpenGL draws the colours all the same."""
        return self.render(pose, labels=False).depth

    def labelled_depth(self, pose: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The depth and the labels, H x W int32; OpenGL draws the colours all the same."""
        image = self.render(pose, labels=True)
        assert image.labels is not None
        return image.depth, image.labels

    def _draw_labels(self) -> np.ndarray:
        """Draw the scene again, coloured by label, as the camera stands."""
        assert self._context is not None
        if self._label_surface is None:
            self._label_surface = _label_surface(self._mesh)
            self._scene.add(self._label_surface)
        self._surfaces.is_visible, self._label_surface.is_visible = False, True
        code, _ = self._context.render(self._scene)
        self._surfaces.is_visible, self._label_surface.is_visible = True, False
        return code.astype(np.int32) @ np.array([1, 256, 65536], dtype=np.int32) - 1


def _colored_surfaces(mesh: SceneMesh) -> Any:
    """The mesh in as many pieces as it has textures: each piece costs a draw call, each copy of a texture memory."""
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


def _label_surface(mesh: SceneMesh) -> Any:
    """The mesh in one piece, each face of the one colour that spells its label + 1 in base 256."""
    pyrender = load_pyrender()
    number = np.repeat(mesh.face_label + 1, 3)
    code = np.stack([number & 255, number >> 8 & 255, number >> 16 & 255], axis=-1)
    return pyrender.Mesh([pyrender.Primitive(positions=mesh.triangles.reshape(-1, 3), color_0=code)])
