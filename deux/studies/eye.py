"""How a comparison looks at what explorers do: through a camera of its own, the same for all of them."""

from dataclasses import replace
from typing import NamedTuple, Protocol

import numpy as np

from deux.contracts import Frame, Scene
from deux.geometry.camera import Camera
from deux.scenes.objects import find_objects
from deux.simulator.embree_renderer import EmbreeRenderer

PIXELS = 64
"""Rows and columns of the images: as many as learned explorers have in training."""


class Look(NamedTuple):
    """What is seen from one pose.

    Args:
        frame: depth and labels; its colour image is empty.
        objects: H x W int32, the number of the object that each pixel shows, -1 where there is none.
    """

    frame: Frame
    objects: np.ndarray


class Eye(Protocol):
    """Looks at one scene."""

    camera: Camera
    label_names: tuple[str, ...]
    objects: int
    """Number of objects in the scene."""

    def look(self, pose: np.ndarray) -> Look:
        """See the scene from a 4 x 4 camera-to-world pose."""


class SceneEye:
    """Looks at a scene that is a mesh.

    Args:
        scene: the scene; its materials are not used.
        camera: the robot's, of which this eye has all but the number of pixels.
    """

    def __init__(self, scene: Scene, camera: Camera) -> None:
        self.camera = replace(camera, width=PIXELS, height=PIXELS)
        self.label_names = scene.mesh.label_names
        found = find_objects(scene.mesh)
        self.objects = len(found.labels)
        self._renderer = EmbreeRenderer(scene, self.camera)
        # Face -1, "none", is the last one.
        self._face_object = np.append(found.face_object, np.int32(-1))
        self._face_label = np.append(scene.mesh.face_label, np.int32(-1))

    def look(self, pose: np.ndarray) -> Look:
        """See the scene from a 4 x 4 camera-to-world pose."""
        depth, face = self._renderer.faces(pose)
        frame = Frame(np.zeros((0, 0, 3), np.uint8), depth, pose, self._face_label[face])
        return Look(frame, self._face_object[face])
