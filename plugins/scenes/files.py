"""The scene source `files`: any .glb, .gltf, .obj or .ply that trimesh reads."""

import functools
import hashlib
import json
import os
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from urllib.parse import unquote

import numpy as np

from deux.contracts import Scene, SceneReference, SceneSource, SceneSplits
from deux.errors import DeuxError, near_matches
from deux.scenes.floor import find_floors
from deux.scenes.mesh_reader import Up, read_mesh
from deux.scenes.splits import SPLITS, check_disjoint, make_splits

SUFFIXES = (".glb", ".gltf", ".obj", ".ply")
LARGEST = 1000.0  # metres


@dataclass(frozen=True)
class FileReference(SceneReference):
    """A scene in a file.

    Args:
        name: the scene's name.
        path: the file, absolute.
        up: the axis of the file that points up, "y" or "z".
    """

    path: Path
    up: Up = "y"

    @property
    def identity(self) -> str:
        """The hash of the file's content, wherever the file lies; read once in each process."""
        return file_identity(self.path, self.up)

    @property
    def file(self) -> Path:
        """The file."""
        return self.path

    def load(self) -> Scene:
        """Read the file."""
        return replace(load_scene(self.path, self.up), name=self.name)


class Files(SceneSource):
    """Mesh files: .glb, .gltf, .obj or .ply in metres, of any building or room.

    Args:
        train: path or paths of the scenes that are explored, relative to the working folder; ~ is the home folder.
        validation: likewise, of the scenes that choose between models.
        test: likewise, of the scenes that are kept for the final numbers.
        up: the axis of the files that points up; z turns them: world (x, y, z) = (x, z, -y) of the file.
        allow_overlap: whether a file may be in two splits.

    Raises:
        DeuxError: a file is missing, has an unknown suffix, or is in two splits.
    """

    def __init__(
        self,
        train: str | list[str] | None = None,
        validation: str | list[str] | None = None,
        test: str | list[str] | None = None,
        up: Up = "y",
        allow_overlap: bool = False,
    ) -> None:
        self._up: Up = up
        self._paths = {split: _paths(asked) for split, asked in zip(SPLITS, (train, validation, test), strict=True)}
        if not allow_overlap:
            check_disjoint(self._paths, "file", ", or set scenes.allow_overlap=true")

    def splits(self) -> SceneSplits:
        """The files of each split, named after their stems."""
        names = _names({path for paths in self._paths.values() for path in paths})
        return make_splits(
            {
                split: [FileReference(names[path], path, self._up) for path in paths]
                for split, paths in self._paths.items()
            }
        )


def _paths(asked: str | Sequence[str] | None) -> tuple[Path, ...]:
    return tuple(check_scene_file(path) for path in ([asked] if isinstance(asked, str) else asked or ()))


def _names(paths: set[Path]) -> dict[Path, str]:
    """A name for each file: its stem; its folder before it where two files share a stem, as in Replica's."""
    stems = Counter(path.stem for path in paths)
    names = {p: p.stem if stems[p.stem] == 1 else f"{p.parent.name}_{p.stem}" for p in paths}
    for name, count in Counter(names.values()).items():
        if count > 1:
            both = " and ".join(str(path) for path in sorted(names) if names[path] == name)
            raise DeuxError(f"the scene files {both} would both be called {name}: rename one or its folder.")
    return names


def load_scene(path: str | Path, up: Up = "y") -> Scene:
    """Read a scene; it is named after the file.

    Geometry and colours are read as `mesh_reader.read_mesh` says.

    Args:
        path: a .glb, .gltf, .obj or .ply in metres.
        up: "z" turns a Z-up file: world (x, y, z) = (x, z, -y) of the file.

    Raises:
        DeuxError: the file, or one that it refers to, is missing, unreadable or holds no triangles or no floor.
    """
    path = check_scene_file(path)
    _parts(path)  # trimesh reads on in silence when one is missing
    mesh = read_mesh(path, up)
    extent = float(np.ptp(mesh.bounds, axis=0).max())
    if extent > LARGEST:
        raise DeuxError(f"{path} is {extent:.0f} m large, but a scene is at most {LARGEST:.0f} m: is it in metres?")
    try:
        floors = find_floors(mesh)
    except DeuxError as error:
        raise DeuxError(f"{path}: {error}") from error
    return Scene(path.stem, mesh, floors, file_identity(path, up))


def check_scene_file(path: str | Path) -> Path:
    """The absolute path of a file that exists and has a known suffix.

    Raises:
        DeuxError: it does not.
    """
    path = Path(os.path.abspath(Path(path).expanduser()))
    if path.suffix.lower() not in SUFFIXES:
        raise DeuxError(f"{path} is no scene file: it must end in one of {', '.join(SUFFIXES)}.")
    if not path.parent.is_dir():
        raise DeuxError(f"there is no scene file {path}: there is no folder {path.parent}.")
    if not path.is_file():
        beside = near_matches(path.name, (p.name for p in path.parent.glob("*") if p.suffix.lower() in SUFFIXES))
        raise DeuxError(f"there is no scene file {path}: {beside}")
    return path


def file_identity(path: Path, up: Up = "y") -> str:
    """A stable string of the content of a scene file and of the files that it refers to; it does not hold the path.

    Raises:
        DeuxError: a file that it refers to is missing, or its textures cannot be read.
    """
    hashes = [_file_hash(part, part.stat().st_size, part.stat().st_mtime_ns) for part in (path, *_parts(path))]
    content = hashes[0] if len(hashes) == 1 else hashlib.sha256("".join(hashes).encode()).hexdigest()
    return f"file:{content[:16]}" + ("" if up == "y" else f":{up}-up")


@functools.cache
def _file_hash(path: Path, size: int, modified: int) -> str:
    # Size and time are there for the cache: a file that changes is read again.
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _parts(path: Path) -> list[Path]:
    """The other files that make up a scene: buffers, material libraries and textures."""
    try:
        names = list(_referenced(path))
    except (ValueError, AttributeError) as error:
        raise DeuxError(f"{path} cannot be read as a {path.suffix} file: {error}.") from error
    for name in names:
        if not (path.parent / name).is_file():
            raise DeuxError(f"{path} needs {name}, which is not in {path.parent}: the two must be kept together.")
    return [path.parent / name for name in names]


def _referenced(path: Path) -> Iterator[str]:
    """The names of the other files, as `path` writes them. What trimesh would skip in silence is an error."""
    suffix = path.suffix.lower()
    if suffix in (".glb", ".gltf"):
        header = json.loads(_glb_header(path) if suffix == ".glb" else path.read_bytes())
        if any(image.get("mimeType") == "image/ktx2" for image in header.get("images", ())):
            raise DeuxError(f"{path} has Basis (KTX2) textures, which cannot be read: take its JPEG or PNG version.")
        for entry in (*header.get("buffers", ()), *header.get("images", ())):
            if "uri" in entry and not entry["uri"].startswith("data:"):
                yield unquote(entry["uri"])
    elif suffix == ".obj":
        for library in _values(path, b"mtllib"):
            yield library
            if (path.parent / library).is_file():
                yield from _values(path.parent / library, b"map_kd")
    else:
        with path.open("rb") as file:
            for line in file:
                if line.startswith(b"comment TextureFile"):
                    yield line.decode().split(maxsplit=2)[2].strip()
                if line.startswith(b"end_header"):
                    break


def _glb_header(path: Path) -> bytes:
    # 12 bytes of file header, then the JSON chunk: length, type, text.
    with path.open("rb") as file:
        start = file.read(20)
        if start[:4] != b"glTF":
            raise ValueError("it does not begin as such a file does")
        whole, there = int.from_bytes(start[8:12], "little"), path.stat().st_size
        if there < whole:
            raise ValueError(f"it is truncated to {there} of {whole} bytes")
        return file.read(int.from_bytes(start[12:16], "little"))


def _values(path: Path, key: bytes) -> list[str]:
    """What follows `key` on the lines of a text file that begin with it in either case."""
    with path.open("rb") as file:
        lines = (line.strip().split(maxsplit=1) for line in file)
        return [line[1].decode().strip() for line in lines if len(line) == 2 and line[0].lower() == key]
