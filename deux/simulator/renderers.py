"""The renderers by name, and what they have in common."""

import importlib
from typing import NamedTuple, Protocol

import numpy as np

from deux.contracts import SceneMesh
from deux.errors import DeuxError, near_matches
from deux.geometry.camera import Camera

RENDERERS = {
    "embree": "deux.simulator.embree_renderer:EmbreeRenderer",
    "pyrender": "deux.simulator.pyrender_renderer:PyrenderRenderer",
}


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
        """Render from N x 4 x 4 camera-to-world matrices (OpenCV camera axes, metres), and only what is asked for."""


def make_renderer(name: str, mesh: SceneMesh, camera: Camera) -> Renderer:
    """Make a renderer by name ("embree" or "pyrender").

    Raises:
        DeuxError: the name is unknown, or the renderer's system libraries are missing.
    """
    if name not in RENDERERS:
        raise DeuxError(f"renderer={name!r} is not known: {near_matches(name, RENDERERS)}")
    # Imported only when chosen, so that one renderer works without the other's libraries.
    module, attribute = RENDERERS[name].split(":")
    renderer: Renderer = getattr(importlib.import_module(module), attribute)(mesh, camera)
    return renderer
