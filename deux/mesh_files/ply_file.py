"""Reader of PLY files: polygons and triangle strips, with textures and colours under all common property names."""

from pathlib import Path

import numpy as np

from deux.contracts import Material
from deux.errors import DeuxError
from deux.mesh_files.mesh_parts import GREY, MeshPart, check_indices
from deux.mesh_files.part_files import find_part, read_textures
from deux.mesh_files.ply_elements import PlyElement, Ragged, read_ply_elements, read_ply_header
from deux.mesh_files.polygons import triangulate

_INDICES = ("vertex_indices", "vertex_index")
_COLORS = (("red", "green", "blue"), ("diffuse_red", "diffuse_green", "diffuse_blue"), ("r", "g", "b"))
_UV = (("s", "t"), ("u", "v"), ("texture_u", "texture_v"), ("texture_s", "texture_t"))
_FACE_UV = ("texcoord", "texcoords")


def read_ply(path: Path, max_texture: int | None = None) -> list[MeshPart]:
    """Read the faces of a PLY file, one part for each texture.

    Textures are listed in the header's `TextureFile` comments and selected for each face by `texnumber`. Textured faces
    have no other colours, because in PLY files these show the same surface at another resolution. Vertex colours take
    precedence over face colours.

    Args:
        path: the file.
        max_texture: greatest size in pixels of a texture's longer side; larger textures are halved; None for no limit.

    Raises:
        DeuxError: the file or a texture is missing or cannot be read, or the file has vertices but no faces.
    """
    elements = read_ply_elements(path)
    vertex, face = elements.get("vertex", {}), elements.get("face", {})
    if any(name not in vertex for name in "xyz"):
        raise DeuxError(f"{path} cannot be read as a scene: its vertices have no x, y and z.")
    vertices = np.stack([np.asarray(vertex[name], np.float64) for name in "xyz"], axis=1)
    index, corner, owner = ply_triangles(elements)
    if len(index) == 0:
        raise DeuxError(f"{path} contains {len(vertices):,} points but no triangles: a scene needs surfaces.")
    check_indices(index, len(vertices), path)
    uv = _corner_uv(face, vertex, index, corner, owner)
    files = referenced_by_ply(path)
    read = read_textures(files, max_texture)
    textures = [read[file] for file in files]
    number = np.where(np.isfinite(uv).all(axis=(1, 2)), _texture_numbers(face, owner, len(index)), -1)
    number[(number < 0) | (number >= len(textures))] = -1

    colors, face_colors = _colors(vertex), _colors(face)
    parts = []
    for shown in np.unique(number):
        of = number == shown
        if shown >= 0:
            material = Material(f"texture {shown}", texture=textures[shown])
            parts.append(MeshPart(vertices, index[of], material, uv[of].astype(np.float32)))
        elif colors is None and face_colors is not None:
            # Face colours become vertex colours if every corner gets its own vertex.
            apart = vertices[index[of]].reshape(-1, 3)
            own = np.repeat(face_colors[owner[of]], 3, axis=0)
            parts.append(MeshPart(apart, np.arange(len(apart)).reshape(-1, 3), Material("colours"), None, own))
        else:
            material = Material("no colours", GREY) if colors is None else Material("colours")
            parts.append(MeshPart(vertices, index[of], material, None, colors))
    return parts


def referenced_by_ply(path: Path) -> list[Path]:
    """The textures of a PLY file, in the order of its header.

    Raises:
        DeuxError: one of them is missing, or the file is not a PLY file.
    """
    names = [c.partition(" ")[2] for c in read_ply_header(path).comments if c.lower().startswith("texturefile ")]
    return [find_part(name, path) for name in names]


def ply_triangles(elements: dict[str, PlyElement]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Triangulate the faces.

    Returns:
        T x 3 vertex indices; T x 3 indices of the corners in the concatenated lists of the faces; T indices of the
        faces.
    """
    lists = _list(elements.get("face", {}), _INDICES)
    if lists is not None:
        index = lists.values.astype(np.int64)
        if (lists.lengths == 3).all():
            corner = np.arange(len(index)).reshape(-1, 3)
            return index.reshape(-1, 3), corner, np.arange(len(corner))
        vertex = elements["vertex"]
        # Clip invalid indices, for which the caller raises an error.
        table = np.stack([np.asarray(vertex[name], np.float64) for name in "xyz"], axis=1)
        points = (table if len(table) else np.zeros((1, 3)))[np.clip(index, 0, max(len(table) - 1, 0))]
        corner, owner = triangulate(points, lists.lengths)
        return index[corner], corner, owner
    strips = _list(elements.get("tristrips", {}), _INDICES)
    if strips is None:
        return np.zeros((0, 3), np.int64), np.zeros((0, 3), np.int64), np.zeros(0, np.int64)
    index = _strip_triangles(strips)
    return index, np.zeros_like(index), np.zeros(len(index), np.int64)


def _strip_triangles(strips: Ragged) -> np.ndarray:
    """Triangles of strips, which end with their list or with an index -1; every second triangle is reversed."""
    ends = np.zeros(len(strips.values) + 1, bool)
    ends[np.cumsum(strips.lengths)] = True  # the next strip begins here
    values = np.insert(strips.values.astype(np.int64), np.flatnonzero(ends[:-1]), -1)
    window = np.lib.stride_tricks.sliding_window_view(values, 3) if len(values) >= 3 else values.reshape(-1, 1)[:0]
    if len(window) == 0:
        return np.zeros((0, 3), np.int64)
    since = np.arange(len(values)) - np.maximum.accumulate(np.where(values < 0, np.arange(len(values)), -1))
    whole = (window >= 0).all(axis=1)
    odd = since[: len(window)][whole] % 2 == 0  # the first triangle begins one place after the -1
    triangles = window[whole].copy()
    triangles[odd] = triangles[odd][:, [1, 0, 2]]
    a, b, c = triangles.T
    return triangles[(a != b) & (b != c) & (a != c)]  # strips are joined by degenerate triangles


def _corner_uv(
    face: PlyElement, vertex: PlyElement, index: np.ndarray, corner: np.ndarray, owner: np.ndarray
) -> np.ndarray:
    """Texture coordinates of the corners, T x 3 x 2, from the faces or else from the vertices; NaN if missing."""
    of_face, corners = _list(face, _FACE_UV), _list(face, _INDICES)
    if of_face is not None and corners is not None:
        # Two numbers for each corner; faces without coordinates have empty lists.
        has = of_face.lengths == 2 * corners.lengths
        place = corner - (np.cumsum(corners.lengths) - corners.lengths)[owner][:, None]
        first = (np.cumsum(of_face.lengths) - of_face.lengths)[owner][:, None] + 2 * place
        values = np.append(of_face.values.astype(np.float64), np.nan)
        first = np.where(has[owner][:, None], first, len(values) - 1)
        return np.stack([values[first], values[np.minimum(first + 1, len(values) - 1)]], axis=2)
    for u, v in _UV:
        if u in vertex and v in vertex:
            return np.stack([np.asarray(vertex[u], np.float64), np.asarray(vertex[v], np.float64)], axis=1)[index]
    return np.full((*index.shape, 2), np.nan)


def _texture_numbers(face: PlyElement, owner: np.ndarray, count: int) -> np.ndarray:
    """The index of each triangle's texture; 0 if it is not specified."""
    stored = face.get("texnumber")
    return np.zeros(count, np.int64) if stored is None else np.asarray(stored, np.int64)[owner]


def _list(element: PlyElement, names: tuple[str, ...]) -> Ragged | None:
    found = next((element[name] for name in names if name in element), None)
    return found if isinstance(found, Ragged) and len(found.values) else None


def _colors(element: PlyElement) -> np.ndarray | None:
    """Colours of vertices or faces, N x 3 uint8, from 8 bits, 16 bits or fractions; None without colours."""
    for names in _COLORS:
        if all(name in element for name in names):
            stored = np.stack([np.asarray(element[name]) for name in names], axis=1)
            if stored.dtype == np.uint16:
                stored = stored // 257
            elif stored.dtype.kind == "f" and len(stored) and np.nanmax(stored) <= 1.0:
                stored = np.nan_to_num(stored) * 255.0
            return np.clip(np.rint(stored), 0, 255).astype(np.uint8) if len(stored) else None
    return None
