"""The contracts of scenes: meshes, references to scenes that are not loaded, and sources of scenes."""

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
        vertices: V x 3 float32, relative to `origin`.
        faces: F x 3 int32, indices into `vertices`.
        uv: F x 3 x 2 float32, texture coordinates of each corner, (0, 0) at the bottom left of the texture.
        face_material: F int32, index into `materials`.
        materials: the materials.
        face_label: F int32, index into `label_names`, -1 where nothing is known.
        label_names: names of the labels, such as "chair".
        vertex_colors: V x 3 uint8, multiplied onto the material; or None.
        origin: world x, y and z of the vertices' (0, 0, 0), as 64-bit floats. Not zero for files in geographic
            coordinates, which float32 resolves to half a metre only.
        pyramids: mip pyramids of the materials' textures, if the textures are views into such pyramids; None if they
            are separate arrays, from which a renderer builds its own.
        face_object: F int32, the object (instance) that each face belongs to, -1 for none; None if the scene does not
            distinguish objects.
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
        """Corner positions relative to `origin`, F x 3 x 3 float32."""
        return self.vertices[self.faces]

    @property
    def bounds(self) -> np.ndarray:
        """2 x 3 float32: minimum and maximum corner of the bounding box, relative to `origin`."""
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
    """A loaded scene.

    Args:
        name: short name, unique within a dataset; names the sequences recorded here.
        mesh: geometry, appearance and labels.
        floors: at least one, the main floor first; heights are in world coordinates, not relative to the mesh's origin.
        identity: see `SceneReference.identity`.
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
        """The whole scene."""
        return SceneArea()

    def load(self) -> Scene:
        """Return itself, so that simulators accept a loaded scene in place of a reference."""
        return self


@dataclass(frozen=True)
class SceneArea:
    """The part of a scene that the robot may enter; simulators restrict free space to it.

    Args:
        floor: "largest" for the floor with the most room for the robot; "all" for every floor, an episode on each; or
            the number of a floor, counted from 0, the lowest.
        region: x_min, z_min, x_max and z_max in world metres, which bound the robot's position; None for no bound.
        start: x and z in world metres of a point of the connected area to use; None for the largest area.

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
    """A reference to a scene that is not loaded: cheap to keep, compare, hash and send to another process.

    Simulators are constructed from it: they call `load` if they work on meshes, or read `file` themselves.

    Args:
        name: the scene's name, unique within its splits.
        area: the part of it that the robot may enter.
    """

    name: str
    area: SceneArea = field(default=SceneArea(), kw_only=True)

    @property
    @abstractmethod
    def identity(self) -> str:
        """What determines the scene, without loading it: generator, version and seed, or the hash of a file's content.

        Equal identities mean equal scenes, so datasets are keyed by it.
        """

    @property
    def file(self) -> Path | None:
        """The scene's file, for simulators that read it themselves; None if there is no file."""
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
        """Generate or read the scene's mesh, anew at each call.

        Raises:
            DeuxError: it cannot be read, or the scene has no mesh.
        """
        means = "makes it by itself" if self.file is None else "reads its file"
        raise DeuxError(f"the scene {self.name} cannot be loaded as a mesh: choose a simulator that {means}.")


@dataclass(frozen=True)
class SceneFiles:
    """The files of one scene on disk.

    Args:
        name: the scene's name.
        files: existing files.
        missing: missing files that are required, such as "17DRP5sb8fy.glb".
        without: missing parts that are optional, such as "labels".
    """

    name: str
    files: tuple[Path, ...] = ()
    missing: tuple[str, ...] = ()
    without: tuple[str, ...] = ()


@dataclass(frozen=True)
class SceneSplits:
    """The scenes of one experiment.

    Args:
        train: scenes to explore.
        validation: scenes to select models by; may be empty.
        test: scenes to evaluate on.
    """

    train: tuple[SceneReference, ...]
    validation: tuple[SceneReference, ...]
    test: tuple[SceneReference, ...]


class SceneSource(ABC):
    """A source of scenes, in three splits. All options are in the constructor.

    Every source has the options `train`, `validation` and `test`, which the configuration group `scale` sets: each is
    a number of scenes, or says which scenes they are.
    """

    @abstractmethod
    def splits(self) -> SceneSplits:
        """The scenes that the options select, not loaded. Equal options give equal splits.

        No two scenes share a name, and none is in two splits unless an option called `allow_overlap` is true.

        Raises:
            DeuxError: a scene is missing, or in two splits.
        """

    def inventory(self) -> dict[str, tuple[SceneFiles, ...]]:
        """List the files of each split's scenes, for `python -m deux.doctor`; nothing is loaded.

        A source that knows the contents of a complete download lists all its scenes, whether selected or not.

        Raises:
            DeuxError: there is nothing to list, such as when the folder is missing.
        """
        splits = self.splits()
        return {
            split: tuple(SceneFiles(scene.name, (scene.file,) if scene.file else ()) for scene in scenes)
            for split, scenes in (("train", splits.train), ("validation", splits.validation), ("test", splits.test))
        }

    def further(self, count: int, without: Collection[str]) -> tuple[SceneReference, ...]:
        """More scenes, for training something that must not see the experiment's own.

        Args:
            count: number of scenes.
            without: identities of scenes to exclude.

        Raises:
            DeuxError: the source does not have that many.
        """
        raise DeuxError(f"{type(self).__name__} has no scenes but those of its splits: name a source that makes them.")
