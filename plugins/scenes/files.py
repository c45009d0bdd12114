"""The scene source `files`: mesh files (.glb, .gltf, .obj, .ply)."""

import functools
import hashlib
import os
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Literal

from deux.contracts import Scene, SceneArea, SceneReference, SceneSource, SceneSplits
from deux.errors import DeuxError, check_range, near_matches
from deux.mesh_files.mesh_reader import SUFFIXES, Up, read_mesh, referenced_files
from deux.scenes.mesh_scene import mesh_scene
from deux.scenes.prepared_scene import prepared_scene
from deux.scenes.splits import SPLITS, check_disjoint, each_once, make_splits


@dataclass(frozen=True)
class FileReference(SceneReference):
    """A scene in a file.

    Args:
        name: the scene's name.
        path: the file, absolute.
        up: the axis of the file that points up, "y" or "z".
        scale: metres per unit of the file.
        max_texture: greatest size in pixels of a texture's longer side; larger textures are halved; None for no limit.
        prepared: the folder of prepared scenes, absolute; None for none.
    """

    path: Path
    up: Up = "y"
    scale: float = 1.0
    max_texture: int | None = None
    prepared: Path | None = None

    @property
    def identity(self) -> str:
        """The hash of the file's content, independent of its path; computed once in each process."""
        return file_identity(self.path, self.up, self.scale, self.max_texture)

    @property
    def file(self) -> Path:
        """The file."""
        return self.path

    def load(self) -> Scene:
        """Open the prepared scene, or read the file."""
        check_scene_file(self.path)
        made = partial(load_scene, self.path, self.up, self.scale, self.max_texture)
        return replace(prepared_scene(self.prepared, self.identity, made), name=self.name)


class Files(SceneSource):
    """Mesh files: .glb, .gltf, .obj or .ply of any building or room.

    Args:
        train: path or paths of the scenes to explore, relative to the working folder; ~ is the home folder.
        validation: likewise, for model selection.
        test: likewise, for the final evaluation.
        up: the axis of the files that points up; "z" rotates them: world (x, y, z) = (x, z, -y) of the file.
        scale: metres per unit of the files, 0.01 for centimetres.
        max_texture: greatest size in pixels of a texture's longer side; larger textures are halved until they fit; null
            for no limit. Decoded textures take 4 bytes of memory for each pixel.
        prepared: a folder in which loaded scenes are cached: they then open at once, and processes share their memory.
            A scene takes 4 bytes for each texel and about 100 for each triangle. The folder can be deleted at any time;
            null for no cache.
        allow_overlap: whether a file may be in two splits.
        floor: the floor of each scene to explore: "largest", "all" for an episode on each, or a number from 0, the
            lowest.
        region: x_min, z_min, x_max and z_max in world metres, the bounds of the robot's centre; null for none.
        start: x and z in world metres of a point in the connected part of the floor to use; null for the largest.

    Raises:
        DeuxError: a file is missing, has an unknown suffix, or is in two splits; or the area is invalid.
    """

    def __init__(
        self,
        train: str | list[str] | None = None,
        validation: str | list[str] | None = None,
        test: str | list[str] | None = None,
        up: Up = "y",
        scale: float = 1.0,
        max_texture: int | None = None,
        prepared: str | None = None,
        allow_overlap: bool = False,
        floor: int | Literal["largest", "all"] = "largest",
        region: tuple[float, float, float, float] | None = None,
        start: tuple[float, float] | None = None,
    ) -> None:
        check_range("scenes.scale", scale, 0.0, ends=False)
        if max_texture is not None:
            check_range("scenes.max_texture", max_texture, 1)
        self._up, self._scale, self._max_texture = up, scale, max_texture
        self._prepared = None if prepared is None else Path(os.path.abspath(Path(prepared).expanduser()))
        self._area = SceneArea(floor, region, start)
        paths = {split: _paths(asked) for split, asked in zip(SPLITS, (train, validation, test), strict=True)}
        contents = _contents({path for listed in paths.values() for path in listed})
        if not allow_overlap:
            check_disjoint(paths, "file", ", or set scenes.allow_overlap=true", contents.__getitem__)
        self._paths = each_once(paths, "file", contents.__getitem__)

    def splits(self) -> SceneSplits:
        """The files of each split, named by their stems."""
        names = _names({path for paths in self._paths.values() for path in paths})
        return make_splits({split: [self._reference(names, p) for p in paths] for split, paths in self._paths.items()})

    def _reference(self, names: Mapping[Path, str], path: Path) -> FileReference:
        return FileReference(
            names[path], path, self._up, self._scale, self._max_texture, self._prepared, area=self._area
        )


def _paths(asked: str | Sequence[str] | None) -> tuple[Path, ...]:
    return tuple(check_scene_file(path) for path in ([asked] if isinstance(asked, str) else asked or ()))


def _contents(paths: Collection[Path]) -> dict[Path, str]:
    """A key of each file's content: a hash if several files have the same size, otherwise the path, which is faster."""
    sizes = Counter(path.stat().st_size for path in paths)
    return {path: str(path) if sizes[path.stat().st_size] == 1 else file_identity(path) for path in paths}


def _names(paths: set[Path]) -> dict[Path, str]:
    """A name for each file: its stem, with its folder as a prefix if two files have the same stem, as in Replica."""
    stems = Counter(path.stem for path in paths)
    names = {p: p.stem if stems[p.stem] == 1 else f"{p.parent.name}_{p.stem}" for p in paths}
    for name, count in Counter(names.values()).items():
        if count > 1:
            both = " and ".join(str(path) for path in sorted(names) if names[path] == name)
            raise DeuxError(f"the scene files {both} would have the same name {name}: rename one or its folder.")
    return names


def load_scene(path: str | Path, up: Up = "y", scale: float = 1.0, max_texture: int | None = None) -> Scene:
    """Read a scene from a file, by whose stem it is named.

    Args:
        path: a .glb, .gltf, .obj or .ply file.
        up: "z" rotates a Z-up file: world (x, y, z) = (x, z, -y) of the file.
        scale: metres per unit of the file.
        max_texture: greatest size in pixels of a texture's longer side; larger textures are halved; None for no limit.

    Raises:
        DeuxError: the file, or one that it refers to, is missing, unreadable or damaged, contains no triangles or no
            floor, or is too large for a building in metres.
    """
    path = check_scene_file(path)
    identity = file_identity(path, up, scale, max_texture)  # first, because it detects missing files quickly
    return mesh_scene(path.stem, read_mesh(path, up, scale, max_texture), identity, str(path), scale)


def check_scene_file(path: str | Path) -> Path:
    """Check that a scene file exists and has a known suffix; returns its absolute path.

    Raises:
        DeuxError: there is no such file, or the suffix is unknown.
    """
    path = Path(os.path.abspath(Path(path).expanduser()))
    if path.suffix.lower() not in SUFFIXES:
        raise DeuxError(f"{path} is not a scene file: its name must end in one of {', '.join(SUFFIXES)}.")
    if not os.path.isdir(path.parent):
        raise DeuxError(f"there is no scene file {path}: there is no folder {path.parent}.")
    if not os.path.isfile(path):
        beside = near_matches(path.name, (p.name for p in path.parent.glob("*") if p.suffix.lower() in SUFFIXES))
        raise DeuxError(f"there is no scene file {path}: {beside}")
    return path


def file_identity(path: Path, up: Up = "y", scale: float = 1.0, max_texture: int | None = None) -> str:
    """A string that identifies the content of a scene file, of the files that it refers to, and the options.

    Raises:
        DeuxError: a file that it refers to is missing, or the file cannot be read.
    """
    hashes = [_file_hash(p, p.stat().st_size, p.stat().st_mtime_ns) for p in (path, *referenced_files(path))]
    content = hashes[0] if len(hashes) == 1 else hashlib.sha256("".join(hashes).encode()).hexdigest()
    options = ("" if up == "y" else f":{up}-up") + ("" if scale == 1.0 else f":x{scale:g}")
    return f"file:{content[:16]}{options}" + ("" if max_texture is None else f":textures{max_texture}")


@functools.cache
def _file_hash(path: Path, size: int, modified: int) -> str:
    # Size and modification time are part of the cache's key: a changed file is read again.
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
