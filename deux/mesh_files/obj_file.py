"""Reader of Wavefront OBJ files, with one part for each material.

Format: Wavefront Technologies, "Advanced Visualizer Manual", appendix B1, 1993; colours after a vertex's position are a
later convention of scanners.
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
"""Greatest number of repetitions of a texture, limited by the precision of float32."""

LONGEST_INDEX = 18
"""Greatest number of digits of an index in a face; more would not fit into 64 bits."""

log = logging.getLogger(__name__)

_REFUSED = {b"curv", b"curv2", b"surf", b"call", b"csh"}
"""Statements for surfaces other than polygons, or for including other files, which are not supported."""


def read_obj(path: Path, max_texture: int | None = None) -> list[MeshPart]:
    """Read the polygons of an OBJ file; lines, points, groups, normals and smoothing are ignored.

    Textures are not multiplied with the diffuse colour (`Kd`) or vertex colours, which exporters set arbitrarily; other
    viewers do the same. Faces without texture coordinates have the colour `Kd`.

    Args:
        path: the file.
        max_texture: greatest size in pixels of a texture's longer side; larger textures are halved; None for no limit.

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
        raise DeuxError(f"{path} is damaged or not a .obj file: {error}.") from error
    vertices, colors = np.ascontiguousarray(positions[:, :3]), _colors(positions)
    index, owner = triangulate(vertices[corners[:, 0]], lengths)
    faces = corners[index, 0]
    uv = np.full((len(coordinates) + 1, 2), np.nan)  # the last entry is for corners without coordinates
    uv[:-1] = np.nan_to_num(coordinates[:, :2])  # a missing second coordinate is 0
    uv = uv[corners[index, 1]]
    textured = np.isfinite(uv).all(axis=(1, 2))

    names, described = statements.material_names, _materials(path, statements.material_names)
    material = np.repeat([run[1] for run in statements.runs], statements.run_lengths).astype(np.int64)[owner]
    used = [described[k].texture for k in np.unique(material[textured])]
    textures = read_textures([texture for texture in used if texture is not None], max_texture)
    parts = []
    for k in np.unique(material):
        own = described[k]
        with_texture = (material == k) & textured & (own.texture is not None)
        plain = (material == k) & ~with_texture
        if own.texture is not None and with_texture.any():
            own_uv = (uv[with_texture] * own.scale + own.offset).astype(np.float32)
            look = Material(names[k], texture=textures[own.texture])
            parts.append(MeshPart(vertices, faces[with_texture], look, own_uv))
        if plain.any():
            color = own.color or (GREY if colors is None else (255, 255, 255))
            parts.append(MeshPart(vertices, faces[plain], Material(names[k], color), None, colors))
    return parts


def referenced_by_obj(path: Path) -> list[Path]:
    """The material libraries of an OBJ file, and the textures of their materials.

    Raises:
        DeuxError: one of them is missing.
    """
    libraries = material_libraries(path)
    textures = [m.texture for library in libraries for m in read_material_library(library, path).values()]
    return list(dict.fromkeys([*libraries, *(texture for texture in textures if texture is not None)]))


def _materials(path: Path, names: Sequence[str]) -> list[ObjMaterial]:
    """The materials with the given names, each from the first library of the OBJ file that contains it."""
    found: dict[str, ObjMaterial] = {}
    for library in material_libraries(path):
        found = read_material_library(library, path) | found
    if unknown := [name for name in names if name and found and name not in found]:
        log.warning("%s: no material library contains %s: it is grey.", path, ", ".join(unknown))
    return [found.get(name, ObjMaterial()) for name in names]


@dataclass
class _Statements:
    """The statements of a file by their kind.

    Args:
        positions: the arguments of `v`.
        coordinates: the arguments of `vt`.
        faces: the arguments of `f`.
        runs: runs of consecutive faces with one material: index of the first face, index into `material_names`, and the
            numbers of positions and coordinates before it, to which negative indices are relative.
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
        """Parse lines; raises ValueError for statements that are not supported."""
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
                raise ValueError(f"its {key.decode()} statements are not supported, only polygons")


def _keyword(line: bytes) -> bytes:
    return line.lstrip()[:8].partition(b" ")[0]


def _joined_lines(content: bytes) -> list[bytes]:
    """The lines of a file without comments; lines that end with a backslash are joined with the next."""
    text = content.replace(b"\r\n", b"\n").replace(b"\r", b"\n").replace(b"\\\n", b" ").replace(b"\t", b" ")
    if b"\0" in text[:1024]:
        raise ValueError("it is not a text file")
    lines = text.split(b"\n")
    return [_without_comment(line) for line in lines] if b"#" in text else lines


def _without_comment(line: bytes) -> bytes:
    """A line without the comment at its end; names of materials may contain "#"."""
    return line if b"#" not in line or _keyword(line) == b"usemtl" else line.partition(b"#")[0]


def _columns(lines: list[bytes], least: int, most: int) -> np.ndarray:
    """The numbers of each line, N x `most`, padded with NaN.

    Raises:
        ValueError: a line has fewer than `least` or more than `most` numbers.
    """
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
    """Vertex colours, V x 3 uint8, from lines `x y z r g b` or `x y z w r g b`, white if missing; None without any."""
    given = np.isfinite(positions)
    six, seven = given[:, 5] & ~given[:, 6], given[:, 6]
    if not (six.any() or seven.any()):
        return None
    values = np.ones((len(positions), 3))
    values[six], values[seven] = positions[six, 3:6], positions[seven, 4:7]
    if values.max() > 1.0:  # in [0, 255] and not in [0, 1]
        values[six | seven] /= 255.0
    return np.rint(np.clip(values, 0.0, 1.0) * 255.0).astype(np.uint8)


def _faces(statements: _Statements, positions: int, coordinates: int) -> tuple[np.ndarray, np.ndarray]:
    """N x 2 indices of position and coordinate (-1 for none) of all corners, and the number of corners per face."""
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
        least = 0 if column == 0 else -1  # texture coordinates are optional
        bad = (corners[:, column] < least) | (corners[:, column] >= count)
        if bad.any():
            face = int(np.searchsorted(np.cumsum(lengths), int(np.argmax(bad)), side="right"))
            line = statements.faces[face].decode(errors="replace")
            raise ValueError(f"the face {shown(line)} refers to a {noun} that does not exist, there are {count}")
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
    """Parse the corners `position/coordinate/normal` of faces, one face per line.

    Args:
        text: bytes; each line ends with a line feed.
        corners: N x 2 int64, receives the stored indices of position and coordinate, 0 for none.
        lengths: number of lines + 1, receives the number of corners of each line.

    Returns:
        The first invalid line, -1 if there is none.
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
