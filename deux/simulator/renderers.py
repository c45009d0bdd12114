"""The renderers by name, and what they have in common."""

import importlib
from typing import NamedTuple, Protocol

import numpy as np

from deux.errors import DeuxError, near_matches
from deux.geometry.camera import Camera
from deux.scenes.scene import Scene

RENDERERS = {
    "embree": "deux.simulator.embree_renderer:EmbreeRenderer",
    "pyrender": "deux.simulator.pyrender_renderer:PyrenderRenderer",
}


class RenderedImage(NamedTuple):
    """What a camera sees.

    Args:
        rgb: H x W x 3 uint8, black where the camera sees nothing.
        depth: H x W float32, metres along the optical axis; 0 where there is nothing in the camera's range.
        labels: H x W int32, index into the mesh's label names, -1 where nothing is labelled or seen; None unless
            asked for.
    """

    rgb: np.ndarray
    depth: np.ndarray
    labels: np.ndarray | None


class Renderer(Protocol):
    """Draws one scene as one camera sees it: surfaces unlit, both sides visible."""

    def render(self, pose: np.ndarray, labels: bool = True) -> RenderedImage:
        """Render from a 4 x 4 camera-to-world matrix (OpenCV camera axes, metres)."""

    def depth(self, pose: np.ndarray) -> np.ndarray:
        """The depth alone, H x W float32, as `render` gives it."""

    def labelled_depth(self, pose: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The depth and the labels, H x W int32, as `render` gives them."""


def make_renderer(name: str, scene: Scene, camera: Camera) -> Renderer:
    """Make a renderer by name ("embree" or "pyrender").

    Raises:
        DeuxError: the name is unknown, or the renderer's system libraries are missing.
    """
    if name not in RENDERERS:
        raise DeuxError(f"renderer={name!r} is not known: {near_matches(name, RENDERERS)}")
    # Imported only when chosen, so that one renderer works without the other's libraries.
    module, attribute = RENDERERS[name].split(":")
    renderer: Renderer = getattr(importlib.import_module(module), attribute)(scene, camera)
    return renderer
