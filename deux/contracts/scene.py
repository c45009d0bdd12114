"""The contract of scenes: geometry and appearance, a locator that is cheap to keep and send, and their sources."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Collection
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np

from deux.errors import DeuxError
from deux.geometry.texture_pyramids import TexturePyramids


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
        vertices: V x 3 float32, from `origin`.
        faces: F x 3 int32, indices into `vertices`.
        uv: F x 3 x 2 float32, texture coordinates of each corner, (0, 0) at the bottom left of the texture.
        face_material: F int32, index into `materials`.
        materials: the materials.
        face_label: F int32, index into `label_names`, -1 where nothing is known.
        label_names: names of the labels, such as "chair".
        vertex_colors: V x 3 uint8, multiplied onto the material; None where there are none.
        origin: world x, y and z of the vertices' (0, 0, 0), as Python's (64-bit) floats. It is not zero where a file is
            in coordinates of a country or of the Earth, which float32 holds to half a metre only.
        pyramids: the mip pyramids of the materials' textures, where these are views into them; None where they are
            arrays of their own, of which whoever needs pyramids makes them.
        face_object: F int32, number of the object (instance) that each face belongs to, -1 where it belongs to none;
            None where the scene does not tell its objects apart.
    """

    vertices: np.ndarray
    faces: np.ndarray
    uv: np.ndarray
    face_material: np.ndarray
    materials: tuple[Material, ...]
    face_label: np.ndarray
    label_names: tuple[str, ...] = ()
    vertex_colors: np.ndarray | None = None
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    pyramids: TexturePyramids | None = None
    face_object: np.ndarray | None = None

    @property
    def triangles(self) -> np.ndarray:
        """Corner positions from `origin`, F x 3 x 3 float32."""
        return self.vertices[self.faces]

    @property
    def bounds(self) -> np.ndarray:
        """2 x 3 float32: the least and the greatest corner, from `origin`."""
        return np.stack([self.vertices.min(axis=0), self.vertices.max(axis=0)])


@dataclass(frozen=True)
class Floor:
    """The floor of one storey of a building.

    Args:
        height: world y of the floor, metres.
        area: square metres of level surface at that height, inside the building.
    """

    height: float
    area: float


@dataclass(frozen=True)
class Scene:
    """A loaded mesh, and what is known about it.

    Args:
        name: short name, unique within a dataset; names the sequences recorded here.
        mesh: geometry, appearance and labels.
        floors: at least one, the main floor first; their heights are of the world, not from the mesh's origin.
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

    @property
    def area(self) -> SceneArea:
        """All of the scene."""
        return SceneArea()

    def load(self) -> Scene:
        """Itself: a simulator takes a loaded scene as it takes a reference to one."""
        return self


@dataclass(frozen=True)
class SceneArea:
    """The part of a scene that the robot lives in; simulators offer no other floor than this.

    Args:
        floor: "largest" takes the floor with the most room for the robot, "all" every floor, an episode on each; a
            number counts the floors from the lowest upwards, 0 is the lowest.
        region: x_min, z_min, x_max and z_max in world metres that the robot stays within; None for no bound.
        start: x and z in world metres of a point whose connected floor is taken; None for the largest one.

    Raises:
        DeuxError: a value is out of its range.
    """

    floor: int | Literal["largest", "all"] = "largest"
    region: tuple[float, float, float, float] | None = None
    start: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        if not (self.floor in ("largest", "all") or (isinstance(self.floor, int) and self.floor >= 0)):
            raise DeuxError(f"scenes.floor is {self.floor!r}, but must be largest, all, or a number from 0 upwards.")
        if self.region is not None and not (self.region[0] < self.region[2] and self.region[1] < self.region[3]):
            raise DeuxError(
                f"scenes.region is {list(self.region)}, but must be [x_min, z_min, x_max, z_max] with each minimum "
                "less than its maximum."
            )


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

    @property
    def scale(self) -> float:
        """Metres per unit of `file`."""
        return 1.0

    def load(self) -> Scene:
        """Make or read the scene as a mesh, anew at each call.

        Raises:
            DeuxError: it cannot be read, or there is no mesh of it.
        """
        means = "makes it by itself" if self.file is None else "reads its file"
        raise DeuxError(f"the scene {self.name} cannot be loaded as a mesh: choose a simulator that {means}.")


@dataclass(frozen=True)
class SceneFiles:
    """What is on disk of one scene.

    Args:
        name: the scene's name.
        files: the files that are there.
        missing: what is needed and not there, such as "17DRP5sb8fy.glb".
        without: what is optional and not there, such as "labels".
    """

    name: str
    files: tuple[Path, ...] = ()
    missing: tuple[str, ...] = ()
    without: tuple[str, ...] = ()


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

        No two scenes share a name, and none is in two splits unless an option called `allow_overlap` is true.

        Raises:
            DeuxError: a scene is missing, or in two splits at once.
        """

    def inventory(self) -> dict[str, tuple[SceneFiles, ...]]:
        """What is on disk of the scenes of each split, for `python -m deux.doctor`; nothing is loaded.

        A source that knows which scenes a complete download has lists all of them, asked for or not.

        Raises:
            DeuxError: there is nothing to look at, such as a folder that is missing.
        """
        splits = self.splits()
        return {
            split: tuple(SceneFiles(scene.name, (scene.file,) if scene.file else ()) for scene in scenes)
            for split, scenes in (("train", splits.train), ("validation", splits.validation), ("test", splits.test))
        }

    def further(self, count: int, without: Collection[str]) -> tuple[SceneReference, ...]:
        """More scenes, for trainings that must not see the experiment's own.

        Args:
            count: number of scenes.
            without: identities of scenes that must not be among them.

        Raises:
            DeuxError: the source cannot make as many.
        """
        raise DeuxError(f"{type(self).__name__} has no scenes but those of its splits: name a source that makes them.")
