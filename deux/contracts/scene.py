"""The contract of scenes: geometry and appearance, a locator that is cheap to keep and send, and their sources."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Collection
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np

from deux.errors import DeuxError


@dataclass(frozen=True)
class Material:
    """An unlit surface: the colour at a point is texture x base colour, with no light and no viewing angle.

    Args:
        name: for messages only.
        color: base colour, 3 x uint8; multiplied onto the texture as color / 255.
        texture: height x width x 3 uint8, row 0 at the top (v = 1), repeated in both directions; or None.
    """

    name: str
    color: tuple[int, int, int] = (255, 255, 255)
    texture: np.ndarray | None = None


@dataclass(frozen=True)
class SceneMesh:
    """Triangles in metres in a Y-up world.

    Args:
        vertices: V x 3 float32.
        faces: F x 3 int32, indices into `vertices`.
        uv: F x 3 x 2 float32, texture coordinates of each corner, (0, 0) at the bottom left of the texture.
        face_material: F int32, index into `materials`.
        materials: the materials.
        face_label: F int32, index into `label_names`, -1 where nothing is known.
        label_names: names of the labels, such as "chair".
        vertex_colors: V x 3 uint8, multiplied onto the material; None where there are none.
    """

    vertices: np.ndarray
    faces: np.ndarray
    uv: np.ndarray
    face_material: np.ndarray
    materials: tuple[Material, ...]
    face_label: np.ndarray
    label_names: tuple[str, ...] = ()
    vertex_colors: np.ndarray | None = None

    @property
    def triangles(self) -> np.ndarray:
        """Corner positions, F x 3 x 3 float32."""
        return self.vertices[self.faces]

    @property
    def bounds(self) -> np.ndarray:
        """2 x 3 float32: the least and the greatest corner."""
        return np.stack([self.vertices.min(axis=0), self.vertices.max(axis=0)])


@dataclass(frozen=True)
class Floor:
    """The floor of one storey of a building.

    Args:
        height: world y of the floor, metres.
        area: square metres of level surface at that height.
    """

    height: float
    area: float


@dataclass(frozen=True)
class Scene:
    """A loaded mesh, and what is known about it.

    Args:
        name: short name, unique within a dataset; names the sequences recorded here.
        mesh: geometry, appearance and labels.
        floors: at least one, the main floor first.
        identity: as of `SceneReference`.
    """

    name: str
    mesh: SceneMesh
    floors: tuple[Floor, ...]
    identity: str

    @property
    def floor_height(self) -> float:
        """World y of the main floor, metres."""
        return self.floors[0].height


@dataclass(frozen=True)
class SceneArea:
    """The part of a scene that the robot lives in; simulators offer no other floor than this.

    Args:
        floor: "largest" takes the floor with the most room for the robot, "all" every floor, an episode on each; a
            number counts the floors from the lowest upwards, 0 is the lowest.
        region: x_min, z_min, x_max and z_max in world metres that the robot stays within; None for no bound.
        start: x and z in world metres of a point whose connected floor is taken; None for the largest one.
    """

    floor: int | Literal["largest", "all"] = "largest"
    region: tuple[float, float, float, float] | None = None
    start: tuple[float, float] | None = None


@dataclass(frozen=True)
class SceneReference(ABC):
    """A locator of a scene that is not loaded: cheap to keep, compare, hash and send to another process.

    A simulator makes itself from it, by `load` if it works on meshes, by `file` if it reads scene files itself.

    Args:
        name: the scene's name, unique within its splits.
        area: the part of it that the robot lives in.
    """

    name: str
    area: SceneArea = field(default=SceneArea(), kw_only=True)

    @property
    @abstractmethod
    def identity(self) -> str:
        """What made the scene (generator version and seed, or the hash of a file's content), without loading it.

        Equal identities mean equal scenes, so it is part of a dataset's key.
        """

    @property
    def file(self) -> Path | None:
        """The scene's file, for simulators that read it themselves; None if it is in no file."""
        return None

    @property
    def up(self) -> Literal["y", "z"]:
        """The axis of `file` that points up; "z": world (x, y, z) = (x, z, -y) of the file."""
        return "y"

    def load(self) -> Scene:
        """Make or read the scene as a mesh, anew at each call.

        Raises:
            DeuxError: it cannot be read, or there is no mesh of it.
        """
        raise DeuxError(f"the scene {self.name} cannot be loaded as a mesh: choose a simulator that reads its file.")


@dataclass(frozen=True)
class SceneSplits:
    """The scenes of one experiment: to explore, to choose by, and to test on.

    Args:
        train: scenes that are explored.
        validation: scenes that choose between models; may be none.
        test: scenes that are kept for the final numbers.
    """

    train: tuple[SceneReference, ...]
    validation: tuple[SceneReference, ...]
    test: tuple[SceneReference, ...]


class SceneSource(ABC):
    """Where scenes come from, and their splits. All options are in the constructor.

    Three of them every source has: `train`, `validation` and `test`, each a number of scenes, or which scenes they
    are. The configuration group `scale` sets them.
    """

    @abstractmethod
    def splits(self) -> SceneSplits:
        """The scenes that the options ask for; nothing is loaded. Equal options give equal splits.

        No two scenes share a name, and none is in two splits unless an option allows it.

        Raises:
            DeuxError: a scene is missing, or in two splits at once.
        """

    def further(self, count: int, without: Collection[str]) -> tuple[SceneReference, ...]:
        """More scenes, for trainings that must not see the experiment's own.

        Args:
            count: number of scenes.
            without: identities of scenes that must not be among them.

        Raises:
            DeuxError: the source cannot make as many.
        """
        raise DeuxError(f"{type(self).__name__} has no scenes but those of its splits: name a source that makes them.")
