"""What the renderers have in common, and how one is made by its name."""

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
"""The renderers by name, imported only when chosen, so that one works without the other's libraries."""


class RenderedImage(NamedTuple):
    """What a camera sees.

    Args:
        depth: H x W float32, metres along the optical axis; 0 where there is nothing in the camera's range.
        rgb: H x W x 3 uint8, black where the camera sees nothing; None unless asked for.
        face: H x W int32, the mesh's face that each pixel shows, -1 where there is none; None unless asked for.
    """

    depth: np.ndarray
    rgb: np.ndarray | None
    face: np.ndarray | None


class Renderer(Protocol):
    """Draws one mesh as one camera sees it: surfaces unlit, both sides visible."""

    def render(self, poses: np.ndarray, colors: bool = True, faces: bool = False) -> list[RenderedImage]:
        """Render from N x 4 x 4 camera-to-world matrices (OpenCV camera axes, metres), and only what is asked for.

        An image depends on its own pose alone, to the last bit.
        """

    def another(self, camera: Camera) -> Renderer:
        """A renderer of the same mesh as another camera sees it; what can be shared is not prepared again."""


def make_renderer(name: str, mesh: SceneMesh, camera: Camera, caster: RayCaster | None = None) -> Renderer:
    """Make a renderer by name.

    Args:
        name: one of `RENDERERS`.
        mesh: what is drawn.
        camera: the camera that sees it.
        caster: rays against `mesh`, where there is one already.

    Raises:
        DeuxError: the name is unknown, or the renderer's system libraries are missing.
    """
    if name not in RENDERERS:
        raise DeuxError(f"simulator.renderer cannot be {name!r}: {near_matches(name, RENDERERS)}")
    module, _, attribute = RENDERERS[name].partition(":")
    made: Renderer = getattr(import_module(module), attribute)(mesh, camera, caster)
    return made
