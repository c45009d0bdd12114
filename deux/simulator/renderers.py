"""The interface of the renderers, and their factory."""

from __future__ import annotations

from importlib import import_module
from typing import NamedTuple, Protocol

import numpy as np

from deux.contracts import SceneMesh
from deux.errors import DeuxError, near_matches
from deux.geometry.camera import Camera
from deux.scenes.ray_caster import RayCaster

RENDERERS = {
    "embree": "deux.simulator.embree_renderer:EmbreeRenderer",
    "gl": "deux.simulator.gl_renderer:GLRenderer",
    "pyrender": "deux.simulator.pyrender_renderer:PyrenderRenderer",
}
"""The renderers by name, imported only when chosen, so that each works without the libraries of the others."""


class RenderedImage(NamedTuple):
    """A rendered image.

    Args:
        depth: H x W float32, metres along the optical axis; 0 if there is no surface in the camera's range.
        rgb: H x W x 3 uint8, black if there is no surface; None unless requested.
        face: H x W int32, index of the mesh's face at each pixel, -1 for none; None unless requested.
    """

    depth: np.ndarray
    rgb: np.ndarray | None
    face: np.ndarray | None


class Renderer(Protocol):
    """Renders one mesh for one camera: unlit, with both sides of surfaces visible."""

    def render(self, poses: np.ndarray, colors: bool = True, faces: bool = False) -> list[RenderedImage]:
        """Render from N x 4 x 4 camera-to-world matrices (OpenCV camera axes, metres).

        An image depends only on its own pose, bit by bit, and not on the other poses.
        """

    def another(self, camera: Camera) -> Renderer:
        """A renderer of the same mesh for another camera; prepared data are shared if possible."""


def make_renderer(name: str, mesh: SceneMesh, camera: Camera, caster: RayCaster | None = None) -> Renderer:
    """Make a renderer by name.

    Args:
        name: one of `RENDERERS`.
        mesh: the scene's mesh.
        camera: the camera.
        caster: a ray caster of `mesh` to reuse.

    Raises:
        DeuxError: the name is unknown, or the renderer's system libraries are missing.
    """
    if name not in RENDERERS:
        raise DeuxError(f"simulator.renderer cannot be {name!r}: {near_matches(name, RENDERERS)}")
    module, _, attribute = RENDERERS[name].partition(":")
    made: Renderer = getattr(import_module(module), attribute)(mesh, camera, caster)
    return made
