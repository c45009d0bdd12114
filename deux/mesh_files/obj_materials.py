"""Material libraries (MTL) of OBJ files: diffuse colours and textures."""

import functools
import os
import re
from dataclasses import dataclass
from itertools import takewhile
from pathlib import Path

import numpy as np

from deux.errors import DeuxError
from deux.io.atomic import read_text_bytes
from deux.io.file_names import is_within
from deux.mesh_files.part_files import find_part

_COUNTS = {
    **dict.fromkeys(("-blendu", "-blendv", "-boost", "-texres", "-clamp", "-bm", "-imfchan", "-type", "-cc"), 1),
    **dict.fromkeys(("-mm",), 2),
    "-colorspace": 1,
}
"""Number of arguments of a texture's option."""
_LARGEST = 1e6  # greatest scale and offset of a texture
_VECTORS = ("-o", "-s", "-t")
"""Options with one to three numbers as arguments."""


@dataclass(frozen=True)
class ObjMaterial:
    """The unlit appearance of a material.

    Args:
        color: the diffuse colour `Kd`, 3 x uint8; None if it is not set.
        texture: the file of `map_Kd`.
        scale: `-s`, by which texture coordinates are multiplied.
        offset: `-o`, which is added to them afterwards.
    """

    color: tuple[int, int, int] | None = None
    texture: Path | None = None
    scale: tuple[float, float] = (1.0, 1.0)
    offset: tuple[float, float] = (0.0, 0.0)


def material_libraries(path: Path) -> list[Path]:
    """The material libraries of an OBJ file, from one or several lines; their names may contain spaces.

    Raises:
        DeuxError: one of them is missing.
    """
    state = path.stat()
    found: list[Path] = []
    for name in _library_names(path, state.st_size, state.st_mtime_ns):
        if is_within(name) and os.path.isfile(path.parent / name):
            found.append(path.parent / name)
        else:
            # Several names on one line, separated by the spaces after their suffixes.
            parts = re.split(r"(?<=\.mtl)\s+", name, flags=re.IGNORECASE)
            found += [find_part(part, path) for part in takewhile(lambda part: not part.startswith("#"), parts)]
    return list(dict.fromkeys(found))


@functools.cache
def _library_names(path: Path, size: int, modified: int) -> list[str]:
    # Size and modification time are part of the cache's key: a changed file is read again.
    content = read_text_bytes(path).replace(b"\\\n", b" ").replace(b"\\\r\n", b" ")
    lines = re.findall(rb"^[ \t]*mtllib[ \t]+([^\r\n]+)", content, re.MULTILINE | re.IGNORECASE)
    return [os.fsdecode(line.strip()) for line in lines]


def read_material_library(library: Path, owner: Path) -> dict[str, ObjMaterial]:
    """Read the materials of a library, by name.

    Of the options of `map_Kd` only `-s` and `-o` are supported, but not filtering, clamping or brightness.

    Args:
        library: the .mtl file.
        owner: the OBJ file; textures are searched in the library's folder, then in this file's folder.

    Raises:
        DeuxError: the library is damaged, or a texture is missing.
    """
    found: dict[str, dict] = {}
    settings: dict = {}
    try:
        for key, *rest in _statements(library):
            value = rest[0] if rest else ""
            if key == "newmtl":
                settings = found.setdefault(value.encode(errors="surrogateescape").decode(errors="replace"), {})
            elif not value:
                continue  # an empty statement
            elif key == "kd" and value.split()[0] not in ("spectral", "xyz"):
                rgb = [float(word) for word in value.split()[:3]]
                settings["color"] = _rgb(rgb if len(rgb) == 3 else rgb[:1] * 3)  # a single number is grey
            elif key == "map_kd":
                settings |= _texture(value, library, owner)
    except (ValueError, IndexError) as error:
        raise DeuxError(f"{library} cannot be read as a material library: {error}.") from error
    return {name: ObjMaterial(**settings) for name, settings in found.items()}


def _texture(value: str, library: Path, owner: Path) -> dict:
    """The file and the options of a `map_Kd` statement; the file name may contain spaces."""
    vectors: dict[str, tuple[float, float]] = {}
    rest = value
    while (words := rest.split(maxsplit=1))[0].lower() in (*_COUNTS, *_VECTORS) and len(words) == 2:
        option, rest = words[0].lower(), words[1]
        numbers: list[float] = []
        for taken in range(_COUNTS.get(option, 3)):
            word, *following = rest.split(maxsplit=1)
            if option in _VECTORS and taken > 0 and not _is_number(word):
                break
            if not following:
                break  # the last word is the file name
            numbers += [float(word)] if option in _VECTORS else []
            if numbers and not abs(numbers[-1]) <= _LARGEST:
                raise ValueError(f"the option {option} of a texture is {word}")
            rest = following[0]
        if numbers:
            default = 0.0 if option == "-o" else 1.0
            vectors[option] = (numbers[0], numbers[1] if len(numbers) > 1 else default)
    texture = find_part(rest, library, library.parent, owner.parent)
    return {"texture": texture, "scale": vectors.get("-s", (1.0, 1.0)), "offset": vectors.get("-o", (0.0, 0.0))}


def _statements(path: Path) -> list[list[str]]:
    """The statements of a library: the keyword in lower case, and its arguments."""
    lines = read_text_bytes(path).replace(b"\r", b"\n").replace(b"\\\n", b" ").split(b"\n")
    # Decode names like file names, so that files with names in other encodings are found.
    stripped = (os.fsdecode(line.strip()) for line in lines)
    words = [line.split(maxsplit=1) for line in stripped if line[:1] not in ("#", "")]
    return [[key.lower(), *(_value(key.lower(), part) for part in rest)] for key, *rest in words]


def _value(key: str, text: str) -> str:
    """The argument of a statement without a comment; names of materials may contain "#"."""
    return text.strip() if key == "newmtl" else text.partition(" #")[0].strip()


def _rgb(fractions: list[float]) -> tuple[int, int, int]:
    red, green, blue = (int(value) for value in np.rint(np.clip(np.nan_to_num(fractions), 0.0, 1.0) * 255.0))
    return red, green, blue


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True
