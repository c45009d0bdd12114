"""Material libraries (MTL) of OBJ files: diffuse colours and textures, and where they lie."""

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
"""How many words follow an option of a texture."""
_LARGEST = 1e6  # of a texture's scale and offset
_VECTORS = ("-o", "-s", "-t")
"""Options that one to three numbers follow."""


@dataclass(frozen=True)
class ObjMaterial:
    """What a material library says of a material's unlit look.

    Args:
        color: the diffuse colour `Kd`, 3 x uint8; None where the library does not say.
        texture: the file of `map_Kd`.
        scale: `-s`, by which texture coordinates are multiplied.
        offset: `-o`, which is then added to them.
    """

    color: tuple[int, int, int] | None = None
    texture: Path | None = None
    scale: tuple[float, float] = (1.0, 1.0)
    offset: tuple[float, float] = (0.0, 0.0)


def material_libraries(path: Path) -> list[Path]:
    """The material libraries that an OBJ file names: on one line or several, with blanks in their names or not.

    Raises:
        DeuxError: one of them is missing.
    """
    state = path.stat()
    found: list[Path] = []
    for name in _library_names(path, state.st_size, state.st_mtime_ns):
        if is_within(name) and os.path.isfile(path.parent / name):
            found.append(path.parent / name)
        else:
            # Several names on one line; a blank within a name does not follow its suffix.
            parts = re.split(r"(?<=\.mtl)\s+", name, flags=re.IGNORECASE)
            found += [find_part(part, path) for part in takewhile(lambda part: not part.startswith("#"), parts)]
    return list(dict.fromkeys(found))


@functools.cache
def _library_names(path: Path, size: int, modified: int) -> list[str]:
    # Size and time are there for the cache: a file that changes is read again.
    content = read_text_bytes(path).replace(b"\\\n", b" ").replace(b"\\\r\n", b" ")
    lines = re.findall(rb"^[ \t]*mtllib[ \t]+([^\r\n]+)", content, re.MULTILINE | re.IGNORECASE)
    return [os.fsdecode(line.strip()) for line in lines]


def read_material_library(library: Path, owner: Path) -> dict[str, ObjMaterial]:
    """Read the materials of a library, by name.

    Of the options of `map_Kd`, `-s` and `-o` are kept; those that change filtering, clamping or brightness are not.

    Args:
        library: the .mtl file.
        owner: the OBJ file; a texture is looked for beside the library, then beside this file.

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
                continue  # an empty statement says nothing
            elif key == "kd" and value.split()[0] not in ("spectral", "xyz"):
                rgb = [float(word) for word in value.split()[:3]]
                settings["color"] = _rgb(rgb if len(rgb) == 3 else rgb[:1] * 3)  # one number stands for all three
            elif key == "map_kd":
                settings |= _texture(value, library, owner)
    except (ValueError, IndexError) as error:
        raise DeuxError(f"{library} cannot be read as a material library: {error}.") from error
    return {name: ObjMaterial(**settings) for name, settings in found.items()}


def _texture(value: str, library: Path, owner: Path) -> dict:
    """The file and the options of a `map_Kd` statement; a name may hold blanks."""
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
                break  # the last word is the file's name, whatever it looks like
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
    """The lines of a library: the keyword in small letters and what follows it."""
    lines = read_text_bytes(path).replace(b"\r", b"\n").replace(b"\\\n", b" ").split(b"\n")
    # Names are decoded as the file system's are, so that those in an older encoding are found.
    stripped = (os.fsdecode(line.strip()) for line in lines)
    words = [line.split(maxsplit=1) for line in stripped if line[:1] not in ("#", "")]
    return [[key.lower(), *(_value(key.lower(), part) for part in rest)] for key, *rest in words]


def _value(key: str, text: str) -> str:
    """What a statement says, without a comment behind it; a material's name may hold a "#"."""
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
