"""A tiny building in the files of the published sets: a Z-up room of 4 x 3 x 2.5 m with a chair's box in it.

In the file x is right, y is north and z is up; read, the world is (x, z, -y) of it.
"""

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import trimesh
from PIL import Image

FLOOR, WALL, CEILING, CHAIR = range(4)
COLORS = np.array([[120, 90, 60], [200, 200, 190], [240, 240, 240], [30, 60, 200]], np.uint8)

CHAIR_AT = (3.0, 1.0)  # x, y of its centre in the file


@dataclass(frozen=True)
class Room:
    """Rectangles in the axes of the file, and the kind of surface of each: FLOOR, WALL, CEILING or CHAIR."""

    vertices: np.ndarray
    quads: np.ndarray
    quad_kind: np.ndarray

    @property
    def faces(self) -> np.ndarray:
        """Two triangles for each rectangle."""
        return self.quads[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3)

    @property
    def kind(self) -> np.ndarray:
        """The kind of surface of each triangle."""
        return np.repeat(self.quad_kind, 2)

    def refined(self, edge: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Vertices, triangles and kinds of the same surfaces in small triangles, as annotations have them."""
        vertices, faces, index = trimesh.remesh.subdivide_to_size(self.vertices, self.faces, edge, return_index=True)
        return vertices, faces, self.kind[index]


BOX = np.array([[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]])
"""The rectangles of a box whose corner 4i + 2j + k is at (x_i, y_j, z_k): west, east, south, north, below, above."""


def room(size: float = 4.0) -> Room:
    """A closed room, `size` m from west to east."""
    (x, y), half = CHAIR_AT, 0.2
    outlines = ([[0, size], [0, 3.0], [0, 2.5]], [[x - half, x + half], [y - half, y + half], [0.0, 0.9]])
    corners = [np.stack(np.meshgrid(*outline, indexing="ij"), axis=-1).reshape(8, 3) for outline in outlines]
    # Seen from inside the room, and from outside the chair.
    quads = np.concatenate([BOX[:, ::-1], BOX + 8])
    return Room(np.concatenate(corners), quads, np.array([WALL] * 4 + [FLOOR, CEILING] + [CHAIR] * 6))


def write_textured(path: Path, made: Room, colors: np.ndarray = COLORS, kind: np.ndarray | None = None) -> None:
    """A .glb or .obj of a room, each kind of surface in the colour of its pixel in a texture of one row."""
    kind = made.kind if kind is None else kind
    vertices = made.vertices[made.faces].reshape(-1, 3)
    uv = np.repeat(np.column_stack([(kind + 0.5) / len(colors), np.full(len(kind), 0.5)]), 3, axis=0)
    material = trimesh.visual.material.PBRMaterial(baseColorTexture=Image.fromarray(colors[None]))
    if path.suffix == ".obj":
        material = trimesh.visual.material.SimpleMaterial(image=Image.fromarray(colors[None]))
    visual = trimesh.visual.TextureVisuals(uv=uv, material=material)
    faces = np.arange(len(vertices)).reshape(-1, 3)
    path.parent.mkdir(parents=True, exist_ok=True)
    trimesh.Trimesh(vertices, faces, visual=visual, process=False).export(path)


def write_ply(path: Path, vertices: np.ndarray, faces: np.ndarray, ascii_: bool = False, **numbers: np.ndarray) -> None:
    """A .ply file: coloured vertices, faces of any one number of corners, and whole numbers for each face."""
    corners = faces.shape[1]
    header = [
        "ply",
        f"format {'ascii' if ascii_ else 'binary_little_endian'} 1.0",
        f"element vertex {len(vertices)}",
        *(f"property float {axis}" for axis in "xyz"),
        *(f"property uchar {name}" for name in ("red", "green", "blue")),
        f"element face {len(faces)}",
        "property list uchar int vertex_indices",
        *(f"property int {name}" for name in numbers),
        "end_header\n",
    ]
    points = np.empty(len(vertices), [("p", "<f4", 3), ("c", "u1", 3)])
    points["p"], points["c"] = vertices, (90, 120, 150)
    polygons = np.empty(len(faces), [("n", "u1"), ("v", "<i4", corners), *((name, "<i4") for name in numbers)])
    polygons["n"], polygons["v"] = corners, faces
    for name, values in numbers.items():
        polygons[name] = values
    path.parent.mkdir(parents=True, exist_ok=True)
    if ascii_:
        rows = [" ".join(map(str, [*row["p"], *row["c"]])) for row in points]
        rows += [" ".join(map(str, [row["n"], *row["v"], *(row[name] for name in numbers)])) for row in polygons]
        path.write_text("\n".join(header) + "\n".join(rows) + "\n")
    else:
        path.write_bytes("\n".join(header).encode() + points.tobytes() + polygons.tobytes())


HOUSE = """ASCII 1.0
H house - 1 1 0 0 3 4 5 1 0 1  0 0 0 0 0  0 0 0 4 3 2.5  0 0 0 0 0
L 0 1 -  2 1.5 1  0 0 0 4 3 2.5  0 0 0 0 0
R 0 0 0 0 k  2 1.5 1  0 0 0 4 3 2.5  2.5 0 0 0 0
P pano 0 0 0  2 1.5 1.2  0 0 0 0 0
C 0 4 floor 2 floor 0 0 0 0 0
C 1 2 wall 1 wall 0 0 0 0 0
C 2 9 dining#chair 3 chair 0 0 0 0 0
C 3 70 ceiling 17 ceiling 0 0 0 0 0
C 4 0 unknown 41 unlabel 0 0 0 0 0

O 0 0 0  2 1.5 0  1 0 0  0 1 0  2 1.5 0.1  0 0 0 0 0 0 0 0
O 1 0 1  2 1.5 1  1 0 0  0 1 0  2 1.5 1.2  0 0 0 0 0 0 0 0
O 2 0 3  2 1.5 2  1 0 0  0 1 0  2 1.5 0.1  0 0 0 0 0 0 0 0
O 3 0 2  3 1 0.4  1 0 0  0 1 0  0.2 0.2 0.4  0 0 0 0 0 0 0 0
O 4 -1 -1  3 1 0.4  1 0 0  0 1 0  0.2 0.2 0.4  0 0 0 0 0 0 0 0
E 0 0 100 12 2 1.5 0 0 0 0 4 3 0  0 0 0 0 0
E 1 1 101 35 2 1.5 1 0 0 0 4 3 2  0 0 0 0 0
E 2 2 102 12 2 1.5 2 0 0 2 4 3 2  0 0 0 0 0
E 3 3 205 1 3 1 0 2 1 0 3 1 1  0 0 0 0 0
"""
"""The objects of a room are numbered as its kinds of surface are; their segments are 100, 101, 102 and 205."""


def write_mp3d(folder: Path, name: str, made: Room, labels: bool = True) -> None:
    """A building of Matterport3D as Habitat-Sim has it."""
    write_textured(folder / name / f"{name}.glb", made)
    (folder / name / f"{name}.navmesh").write_bytes(b"navmesh")
    if labels:
        vertices, faces, kind = made.refined(0.3)
        write_ply(folder / name / f"{name}_semantic.ply", vertices, faces, object_id=kind)
        (folder / name / f"{name}.house").write_text(HOUSE)


def write_original_mp3d(folder: Path, name: str, made: Room) -> None:
    """A building of Matterport3D as it is downloaded from the set's own home page."""
    write_textured(folder / name / "matterport_mesh" / "abc" / "abc.obj", made)
    segment = np.array([100, 101, 102, 205])[made.kind]
    write_ply(
        folder / name / "house_segmentations" / f"{name}.ply",
        made.vertices,
        made.faces,
        material_id=segment,
        segment_id=made.kind,
        category_id=made.kind,
    )
    (folder / name / "house_segmentations" / f"{name}.house").write_text(HOUSE)


def write_hm3d(folder: Path, name: str, made: Room, labels: bool = True) -> None:
    """A building of HM3D; the chair is instance 7, and a colour of the semantic mesh is in no line."""
    scene_id = name[6:]
    write_textured(folder / name / f"{scene_id}.glb", made)
    (folder / name / f"{scene_id}.basis.navmesh").write_bytes(b"navmesh")
    if labels:
        write_textured(folder / name / f"{scene_id}.semantic.glb", made, 255 - COLORS)
        hexadecimal = ["".join(f"{value:02X}" for value in color) for color in 255 - COLORS]
        lines = [
            "HM3D Semantic Annotations",
            f'1,{hexadecimal[FLOOR]},"floor",0',
            f'2,{hexadecimal[WALL]},"wall",0',
            f'7,{hexadecimal[CHAIR]},"chair, dining",0',
            '8,010203,"unknown",0',
        ]
        (folder / name / f"{scene_id}.semantic.txt").write_text("\n".join(lines) + "\n")


def write_replica(folder: Path, name: str, made: Room) -> None:
    """A scene of Replica: quads with vertex colours, and one object for each kind of surface from 11 on."""
    write_ply(folder / name / "mesh.ply", made.vertices, made.quads)
    semantic = folder / name / "habitat" / "mesh_semantic.ply"
    write_ply(semantic, made.vertices, made.quads, object_id=made.quad_kind + 11)
    objects = [{"id": k + 11, "class_id": 40 + k, "class_name": c} for k, c in enumerate(["floor", "wall", "ceiling"])]
    objects.append({"id": CHAIR + 11, "class_id": 20, "class_name": "chair"})
    listing = folder / name / "habitat" / "info_semantic.json"
    listing.write_text(json.dumps({"gravity_dir": [0.0, 0.0, -1.0], "objects": objects}))


def label_at(mesh, x: float, y: float, z: float) -> str | None:
    """The label of the face whose centroid is nearest to a point of the file (metres), None where it has none."""
    point = np.array([x, z, -y])
    face = np.linalg.norm(mesh.triangles.mean(axis=1) - point, axis=1).argmin()
    label = mesh.face_label[face]
    return None if label < 0 else mesh.label_names[label]
