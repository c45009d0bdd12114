"""OpenGL framebuffers, and reading images from them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import cv2
import numpy as np

from deux.compilation import compiled
from deux.geometry.camera import Camera
from deux.simulator.renderers import RenderedImage

if TYPE_CHECKING:
    import moderngl


class RenderTarget:
    """The framebuffer of one image.

    Args:
        gl: the context, which must be current at each call.
        camera: the camera, which determines the size.
        colors: whether it has an attachment for colours beside the depth.
        faces: whether it has an attachment for faces.
    """

    def __init__(self, gl: moderngl.Context, camera: Camera, colors: bool, faces: bool) -> None:
        self.colors, self.faces = colors, faces
        size = camera.width, camera.height
        self._depth = gl.texture(size, 1, dtype="f4")
        self._color = gl.texture(size, 4) if colors else None
        self._face = gl.texture(size, 1, dtype="i4") if faces else None
        attachments = [texture for texture in (self._depth, self._color, self._face) if texture is not None]
        self.frame = gl.framebuffer(attachments, gl.depth_renderbuffer(size))

    def begin(self, new: bool) -> None:
        """Make this framebuffer the target of drawing.

        Args:
            new: whether to clear it.
        """
        self.frame.use()
        if new:
            self.frame.clear(depth=1.0)

    def depth(self) -> np.ndarray:
        """The depth drawn so far, H x W float32 metres, 0 = none."""
        depth = np.empty((self._depth.height, self._depth.width), np.float32)
        self._depth.read_into(depth)
        return depth

    def read(self, camera: Camera, face_order: np.ndarray) -> RenderedImage:
        """Wait for the image and copy it to arrays.

        Args:
            camera: the camera, to whose range the depth is limited.
            face_order: the mesh's face at each position of the order of drawing.
        """
        shape = camera.height, camera.width
        depth = self.depth()
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


@compiled(nogil=True)
def _clear_out_of_range(depth: np.ndarray, least: float, most: float) -> None:
    for row in range(depth.shape[0]):
        for column in range(depth.shape[1]):
            if depth[row, column] < least or depth[row, column] > most:
                depth[row, column] = 0.0
