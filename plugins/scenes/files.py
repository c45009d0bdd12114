"""The scene source `files`: any .glb, .gltf, .obj or .ply."""

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
        max_texture: the most pixels that the longer side of a texture keeps; None for all.
        prepared: the folder of prepared scenes, absolute; None for none.
    """

    path: Path
    up: Up = "y"
    scale: float = 1.0
    max_texture: int | None = None
    prepared: Path | None = None

    @property
    def identity(self) -> str:
        """The hash of the file's content, wherever the file lies; read once in each process."""
        return file_identity(self.path, self.up, self.scale, self.max_texture)

    @property
    def file(self) -> Path:
        """The file."""
        return self.path

    def load(self) -> Scene:
        """Read the file, or open what was prepared of it."""
        check_scene_file(self.path)
        made = partial(load_scene, self.path, self.up, self.scale, self.max_texture)
        return replace(prepared_scene(self.prepared, self.identity, made), name=self.name)


class Files(SceneSource):
    """Mesh files: .glb, .gltf, .obj or .ply of any building or room.

    Args:
        train: path or paths of the scenes that are explored, relative to the working folder; ~ is the home folder.
        validation: likewise, of the scenes that choose between models.
        test: likewise, of the scenes that are kept for the final numbers.
        up: the axis of the files that points up; z turns them: world (x, y, z) = (x, z, -y) of the file.
        scale: metres per unit of the files, 0.01 for centimetres.
        max_texture: the most pixels that the longer side of a texture keeps, larger ones are halved until they fit;
            null keeps all. Decoded textures take 4 bytes of memory for each pixel.
        prepared: a folder in which a scene is kept as it is used once it was read: it then opens at once, and
            processes share its memory. It takes 4 bytes for each pixel of the textures and about 100 for each
            triangle, and can be deleted at any time; null keeps nothing.
        allow_overlap: whether a file may be in two splits.
        floor: the floor of each scene that the robot lives on: "largest", "all" for an episode on each, or a number
            that counts them from the lowest, which is 0.
        region: x_min, z_min, x_max and z_max in world metres that the robot stays within.
        start: x and z in world metres of a point of the part of the floor that is taken; the largest one otherwise.

    Raises:
        DeuxError: a file is missing, has an unknown suffix, or is in two splits; or there can be no such area.
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
        """The files of each split, named after their stems."""
        names = _names({path for paths in self._paths.values() for path in paths})
        return make_splits({split: [self._reference(names, p) for p in paths] for split, paths in self._paths.items()})

    def _reference(self, names: Mapping[Path, str], path: Path) -> FileReference:
        return FileReference(
            names[path], path, self._up, self._scale, self._max_texture, self._prepared, area=self._area
        )


def _paths(asked: str | Sequence[str] | None) -> tuple[Path, ...]:
    return tuple(check_scene_file(path) for path in ([asked] if isinstance(asked, str) else asked or ()))


def _contents(paths: Collection[Path]) -> dict[Path, str]:
    """What tells the content of files apart: for files of one size a hash, for all others the path, which is quick."""
    sizes = Counter(path.stat().st_size for path in paths)
    return {path: str(path) if sizes[path.stat().st_size] == 1 else file_identity(path) for path in paths}


def _names(paths: set[Path]) -> dict[Path, str]:
    """A name for each file: its stem; its folder before it where two files share a stem, as in Replica's."""
    stems = Counter(path.stem for path in paths)
    names = {p: p.stem if stems[p.stem] == 1 else f"{p.parent.name}_{p.stem}" for p in paths}
    for name, count in Counter(names.values()).items():
        if count > 1:
            both = " and ".join(str(path) for path in sorted(names) if names[path] == name)
            raise DeuxError(f"the scene files {both} would both be called {name}: rename one or its folder.")
    return names


def load_scene(path: str | Path, up: Up = "y", scale: float = 1.0, max_texture: int | None = None) -> Scene:
    """Read a scene; it is named after the file.

    Args:
        path: a .glb, .gltf, .obj or .ply.
        up: "z" turns a Z-up file: world (x, y, z) = (x, z, -y) of the file.
        scale: metres per unit of the file.
        max_texture: the most pixels that the longer side of a texture keeps; None for all.

    Raises:
        DeuxError: the file, or one that it refers to, is missing, unreadable or damaged, or holds no triangles or no
            floor, or is too large for a building in metres.
    """
    path = check_scene_file(path)
    identity = file_identity(path, up, scale, max_texture)  # also finds out whether a part of it is missing
    return mesh_scene(path.stem, read_mesh(path, up, scale, max_texture), identity, str(path), scale)


def check_scene_file(path: str | Path) -> Path:
    """The absolute path of a file that exists and has a known suffix.

    Raises:
        DeuxError: it does not.
    """
    path = Path(os.path.abspath(Path(path).expanduser()))
    if path.suffix.lower() not in SUFFIXES:
        raise DeuxError(f"{path} is no scene file: it must end in one of {', '.join(SUFFIXES)}.")
    if not os.path.isdir(path.parent):
        raise DeuxError(f"there is no scene file {path}: there is no folder {path.parent}.")
    if not os.path.isfile(path):
        beside = near_matches(path.name, (p.name for p in path.parent.glob("*") if p.suffix.lower() in SUFFIXES))
        raise DeuxError(f"there is no scene file {path}: {beside}")
    return path


def file_identity(path: Path, up: Up = "y", scale: float = 1.0, max_texture: int | None = None) -> str:
    """A stable string of the content of a scene file and of the files that it refers to; it does not hold the path.

    Raises:
        DeuxError: a file that it refers to is missing, or the file cannot be read.
    """
    hashes = [_file_hash(p, p.stat().st_size, p.stat().st_mtime_ns) for p in (path, *referenced_files(path))]
    content = hashes[0] if len(hashes) == 1 else hashlib.sha256("".join(hashes).encode()).hexdigest()
    options = ("" if up == "y" else f":{up}-up") + ("" if scale == 1.0 else f":x{scale:g}")
    return f"file:{content[:16]}{options}" + ("" if max_texture is None else f":textures{max_texture}")


@functools.cache
def _file_hash(path: Path, size: int, modified: int) -> str:
    # Size and time are there for the cache: a file that changes is read again.
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
