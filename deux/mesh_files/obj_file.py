"""Meshes from Wavefront OBJ files, one part for each material.

The format: Wavefront Technologies, "Advanced Visualizer Manual", appendix B1, 1993; the colours after a vertex's
position are a later custom of scanners.
"""

import logging
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import groupby
from pathlib import Path

import numpy as np

from deux.compilation import compiled
from deux.contracts import Material
from deux.errors import DeuxError, shown
from deux.io.atomic import read_text_bytes
from deux.mesh_files.mesh_parts import GREY, MeshPart
from deux.mesh_files.obj_materials import ObjMaterial, material_libraries, read_material_library
from deux.mesh_files.part_files import read_textures
from deux.mesh_files.polygons import triangulate

LARGEST_REPETITION = 1e6
"""Times that a texture may be repeated; beyond, float32 cannot tell its pixels apart."""

LONGEST_INDEX = 18
"""Digits of an index in a face; more would not fit into 64 bits and point at another vertex."""

log = logging.getLogger(__name__)

_REFUSED = {b"curv", b"curv2", b"surf", b"call", b"csh"}
"""Statements that describe a surface otherwise than by polygons, or that read other files."""


def read_obj(path: Path, max_texture: int | None = None) -> list[MeshPart]:
    """Read the polygons of an OBJ file; its lines, points, groups, normals and smoothing are left out.

    A textured material shows its texture alone, as viewers do: exporters leave arbitrary diffuse colours (`Kd`) and
    vertex colours beside them. Faces without texture coordinates show the `Kd`.

    Args:
        path: the file.
        max_texture: the most pixels that the longer side of a texture keeps; None for all.

    Raises:
        DeuxError: the file, a material library or a texture is missing or cannot be read, or a face is damaged.
    """
    statements = _Statements()
    try:
        statements.read(_joined_lines(read_text_bytes(path)))
        positions = _columns(statements.positions, 3, 7)
        coordinates = _columns(statements.coordinates, 1, 3)
        if (beyond := np.abs(coordinates[:, :2]) > LARGEST_REPETITION).any():
            raise ValueError(f"a texture coordinate is {coordinates[:, :2][beyond][0]:g}")
        corners, lengths = _faces(statements, len(positions), len(coordinates))
    except ValueError as error:
        raise DeuxError(f"{path} cannot be read as a .obj file, it is damaged or something else: {error}.") from error
    vertices, colors = np.ascontiguousarray(positions[:, :3]), _colors(positions)
    index, owner = triangulate(vertices[corners[:, 0]], lengths)
    faces = corners[index, 0]
    uv = np.full((len(coordinates) + 1, 2), np.nan)  # the last one is that of corners without any
    uv[:-1] = np.nan_to_num(coordinates[:, :2])  # a second coordinate may be left out: 0
    uv = uv[corners[index, 1]]
    textured = np.isfinite(uv).all(axis=(1, 2))

    names, looks = statements.material_names, _looks(path, statements.material_names)
    material = np.repeat([run[1] for run in statements.runs], statements.run_lengths).astype(np.int64)[owner]
    shown = [looks[k].texture for k in np.unique(material[textured])]
    textures = read_textures([texture for texture in shown if texture is not None], max_texture)
    parts = []
    for k in np.unique(material):
        look = looks[k]
        shows = (material == k) & textured & (look.texture is not None)
        plain = (material == k) & ~shows
        if look.texture is not None and shows.any():
            moved = (uv[shows] * look.scale + look.offset).astype(np.float32)
            parts.append(MeshPart(vertices, faces[shows], Material(names[k], texture=textures[look.texture]), moved))
        if plain.any():
            color = look.color or (GREY if colors is None else (255, 255, 255))
            parts.append(MeshPart(vertices, faces[plain], Material(names[k], color), None, colors))
    return parts


def referenced_by_obj(path: Path) -> list[Path]:
    """The material libraries of an OBJ file and the textures that they name.

    Raises:
        DeuxError: one of them is missing.
    """
    libraries = material_libraries(path)
    textures = [m.texture for library in libraries for m in read_material_library(library, path).values()]
    return list(dict.fromkeys([*libraries, *(texture for texture in textures if texture is not None)]))


def _looks(path: Path, names: Sequence[str]) -> list[ObjMaterial]:
    """The materials of these names by the libraries that an OBJ file names, by the first of several that has one."""
    found: dict[str, ObjMaterial] = {}
    for library in material_libraries(path):
        found = read_material_library(library, path) | found
    if unknown := [name for name in names if name and found and name not in found]:
        log.warning("%s: no material library describes %s: it is grey.", path, ", ".join(unknown))
    return [found.get(name, ObjMaterial()) for name in names]


@dataclass
class _Statements:
    """The lines of a file by what they describe.

    Args:
        positions: what follows `v`.
        coordinates: what follows `vt`.
        faces: what follows `f`.
        runs: of faces one after the other of one material: number of the first face, index into `material_names`, and
            how many positions and coordinates there were before it, from which negative indices count.
    """

    positions: list[bytes] = field(default_factory=list)
    coordinates: list[bytes] = field(default_factory=list)
    faces: list[bytes] = field(default_factory=list)
    runs: list[tuple[int, int, int, int]] = field(default_factory=list)
    material_names: list[str] = field(default_factory=lambda: [""])

    @property
    def run_lengths(self) -> np.ndarray:
        """The number of faces in each run."""
        return np.diff([run[0] for run in self.runs] + [len(self.faces)])

    def read(self, lines: Sequence[bytes]) -> None:
        """Sort lines; ValueError at a statement that is not read."""
        material = 0
        for key, group in groupby(lines, key=_keyword):
            values = (line.strip().partition(b" ")[2] for line in group)
            if key == b"v":
                self.positions.extend(values)
            elif key == b"vt":
                self.coordinates.extend(values)
            elif key in (b"f", b"fo"):
                self.runs.append((len(self.faces), material, len(self.positions), len(self.coordinates)))
                self.faces.extend(values)
            elif key == b"usemtl":
                name = list(values)[-1].strip().decode(errors="replace")
                if name not in self.material_names:
                    self.material_names.append(name)
                material = self.material_names.index(name)
            elif key in _REFUSED:
                raise ValueError(f"its {key.decode()} statements are not read, only polygons are")


def _keyword(line: bytes) -> bytes:
    return line.lstrip()[:8].partition(b" ")[0]


def _joined_lines(content: bytes) -> list[bytes]:
    """The lines of a file, without comments; a backslash at the end of a line joins it to the next."""
    text = content.replace(b"\r\n", b"\n").replace(b"\r", b"\n").replace(b"\\\n", b" ").replace(b"\t", b" ")
    if b"\0" in text[:1024]:
        raise ValueError("it is no text")
    lines = text.split(b"\n")
    return [_without_comment(line) for line in lines] if b"#" in text else lines


def _without_comment(line: bytes) -> bytes:
    """A line without the comment at its end; the name of a material may hold a "#"."""
    return line if b"#" not in line or _keyword(line) == b"usemtl" else line.partition(b"#")[0]


def _columns(lines: list[bytes], least: int, most: int) -> np.ndarray:
    """The numbers of each line, N x `most`, NaN where a line has fewer; ValueError where it has fewer than `least`."""
    values = np.fromstring(b" ".join(lines), sep=" ")
    if not lines:
        return np.zeros((0, most))
    width = len(lines[0].split())
    widths = np.full(len(lines), width)
    if len(values) != width * len(lines) or any(len(line.split()) != width for line in lines):
        widths = np.array([len(line.split()) for line in lines])
    if widths.min() < least or widths.max() > most or widths.sum() != len(values):
        wrong = lines[int(np.argmax((widths < least) | (widths > most)))]
        raise ValueError(f"a vertex has the numbers {shown(wrong.decode(errors='replace'))}")
    result = np.full((len(lines), most), np.nan)
    result[np.arange(most) < widths[:, None]] = values
    return result


def _colors(positions: np.ndarray) -> np.ndarray | None:
    """Colours of the vertices, V x 3 uint8, from lines `x y z r g b` or `x y z w r g b`; white where there are none."""
    given = np.isfinite(positions)
    six, seven = given[:, 5] & ~given[:, 6], given[:, 6]
    if not (six.any() or seven.any()):
        return None
    values = np.ones((len(positions), 3))
    values[six], values[seven] = positions[six, 3:6], positions[seven, 4:7]
    if values.max() > 1.0:  # not fractions but bytes
        values[six | seven] /= 255.0
    return np.rint(np.clip(values, 0.0, 1.0) * 255.0).astype(np.uint8)


def _faces(statements: _Statements, positions: int, coordinates: int) -> tuple[np.ndarray, np.ndarray]:
    """Corners of all faces: N x 2 indices of position and coordinate (-1 for none), and how many each face has."""
    text = np.frombuffer(b"\n".join(statements.faces) + b"\n", np.uint8)
    lengths = np.zeros(len(statements.faces) + 1, np.int64)
    corners = np.zeros((_count_tokens(text), 2), np.int64)
    wrong = _parse_faces(text, corners, lengths)
    lengths = lengths[:-1]
    if wrong >= 0:
        raise ValueError(f"a face has the corners {shown(statements.faces[wrong].decode(errors='replace'))}")
    before = np.array([run[2:] for run in statements.runs], np.int64).reshape(-1, 2)
    before = np.repeat(np.repeat(before, statements.run_lengths, axis=0), lengths, axis=0)
    corners = np.where(corners < 0, before + corners, corners - 1)
    for column, (count, noun) in enumerate(((positions, "vertex"), (coordinates, "texture coordinate"))):
        least = 0 if column == 0 else -1  # a corner may do without a texture coordinate
        bad = (corners[:, column] < least) | (corners[:, column] >= count)
        if bad.any():
            face = int(np.searchsorted(np.cumsum(lengths), int(np.argmax(bad)), side="right"))
            line = statements.faces[face].decode(errors="replace")
            raise ValueError(f"the face {shown(line)} has a {noun} that is not there, there are {count}")
    return corners, lengths


@compiled(nogil=True)
def _count_tokens(text: np.ndarray) -> int:
    count, inside = 0, False
    for byte in text:
        blank = byte == 32 or byte == 10
        count += inside and blank
        inside = not blank
    return count


@compiled(nogil=True)
def _parse_faces(text: np.ndarray, corners: np.ndarray, lengths: np.ndarray) -> int:
    """Parse the corners `position/coordinate/normal` of faces, one face a line.

    Args:
        text: bytes; each line ends with a line feed.
        corners: N x 2 int64, filled with position and coordinate as they are written; 0 where there is none.
        lengths: one more than there are lines, filled with the number of corners of each line.

    Returns:
        The first line that is damaged, -1 if none is.
    """
    line, corner, column, number, sign, digits = 0, 0, 0, 0, 1, 0
    for byte in text:
        if 48 <= byte <= 57:
            number = 10 * number + (byte - 48)
            digits += 1
            if digits > LONGEST_INDEX:
                return line
        elif byte == 45 and digits == 0:
            sign = -1
        elif byte == 47 or byte == 32 or byte == 10:
            if digits > 0 and column < 2:
                corners[corner, column] = sign * number
            started = digits > 0 or column > 0
            if column == 0 and ((digits > 0 and number == 0) or (digits == 0 and byte == 47)):
                return line
            number, sign, digits = 0, 1, 0
            if byte == 47:
                column += 1
                continue
            column = 0
            if started:
                corner += 1
                lengths[line] += 1
            if byte == 10:
                line += 1
        else:
            return line
    return -1
