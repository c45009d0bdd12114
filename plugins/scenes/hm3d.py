"""The scene source `hm3d`: Habitat-Matterport 3D, 1000 scanned buildings, some with instance labels."""

import csv
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from deux.contracts import Scene, SceneMesh
from deux.errors import DeuxError, shown
from deux.mesh_files.mesh_reader import read_mesh
from deux_plugins.scenes.scan_dataset import ScanDataset, ScanFiles, ScanReference
from deux_plugins.scenes.surface_labels import LabelledSurface, look_up, surface_samples

INDICES = {"train": range(800), "val": range(800, 900), "minival": range(800, 810)}
"""The scene indices in each of the dataset's folders; those of minival are also in val."""

SCENE_FOLDER = re.compile(r"(\d{5})-(\w{11})")

HEADER = "HM3D Semantic Annotations"

NOTHING_KNOWN = ("unknown", "unannotated", "unlabeled", "")
"""Categories that count as unlabelled."""


@dataclass(frozen=True)
class HM3DReference(ScanReference):
    """A building of HM3D; `annotation` is its .semantic.txt and its .semantic.glb.

    `path` is the .glb with JPEG or PNG textures or, if it does not exist, the .basis.glb.
    """

    @property
    def file(self) -> Path:
        """The .basis.glb, to which the dataset's navigation meshes and configurations refer, if it exists."""
        basis = self.path.with_name(f"{_scan_id(self.name)}.basis.glb")
        return basis if basis.is_file() else self.path

    def load(self) -> Scene:
        """Read the mesh, and label its faces if there are labels."""
        try:
            return super().load()
        except DeuxError as error:
            if not self.path.name.endswith(".basis.glb"):
                raise
            raise DeuxError(
                f"{str(error).rstrip('.')}; the HM3D archives with _glb or -glb in their names contain "
                f"{_scan_id(self.name)}.glb, whose textures are plain images: put it into the same folder."
            ) from error

    def surface(self) -> LabelledSurface:
        """The surfaces of the semantic mesh, whose colours encode the instances."""
        listing, mesh_file = self.annotation
        categories = read_instances(listing)
        mesh = read_mesh(mesh_file, "z")
        owner, weights = surface_samples(mesh.triangles)
        points = np.einsum("pk,pkd->pd", weights, mesh.triangles[owner]) + mesh.origin
        colors = _colors(mesh, owner, weights).astype(np.int64) @ (1 << 16, 1 << 8, 1)
        instances = look_up({color: number for color, (number, _) in categories.items()}, colors)
        names = tuple(sorted({name for _, name in categories.values() if name.lower() not in NOTHING_KNOWN}))
        numbers = {name: k for k, name in enumerate(names)}
        labels = look_up({number: numbers.get(name, -1) for number, name in categories.values()}, instances)
        return LabelledSurface(points, labels.astype(np.int32), instances.astype(np.int32), names)


class HM3D(ScanDataset):
    """Habitat-Matterport 3D (HM3D): 1000 scanned buildings, some of them with a label for every object.

    The layout is `hm3d/{train,val,minival}/<index>-<id>/<id>.glb`, or `<id>.basis.glb` for simulators that can read it,
    with `<id>.semantic.glb` and `<id>.semantic.txt` for the labels. The splits are as in the DEUX paper: the 800
    buildings of train, the 10 of minival for validation and the 100 of val for test. Since the buildings of minival are
    also in val, those used for validation are excluded from the test, which leaves 90.

    Args:
        root: the folder that contains train, val and minival, or its parent.
        train: number of buildings to explore, null for all of the split, or a list of indices ("00800"), ids
            or both ("00800-TEEsavR23oF").
        validation: likewise, for model selection.
        test: likewise, for the final evaluation.
        limit: greatest number of buildings in each split, from its beginning; null for no limit.
        labels: whether to read the dataset's labels, if they are on disk.
        max_texture: greatest size in pixels of a texture's longer side; larger textures are halved; null for no limit.
        prepared: the folder in which prepared scenes are cached, see `scenes=files`; null for none.
        floor: "largest" for the floor with the most free space, "all" for an episode on each, or 0 (the lowest) and up.
        region: x_min, z_min, x_max and z_max in world metres, the bounds of the robot's centre; null for none.
        start: x and z in world metres of a point in the connected part of the floor to use; null for the largest.

    Raises:
        DeuxError: a building is missing, incomplete or in two splits.
    """

    title = "HM3D"
    source = "HM3D's home page (aihabitat.org/datasets/hm3d) offers them as hm3d-{train,val,minival}-glb-v0.2.tar"
    layout = "train, val or minival with folders such as 00800-TEEsavR23oF in it"
    folders = ("hm3d",)
    reference_type = HM3DReference

    def is_folder(self, folder: Path) -> bool:
        """Whether the folder contains a split with a building."""
        return any(_found(folder / split) for split in INDICES)

    def names(self, folder: Path) -> dict[str, list[str]]:
        """The names of the folders of each split, or the index alone if a folder does not exist."""
        found = {split: _found(folder / split) for split in INDICES}
        found["minival"] = found["val"] | found["minival"]
        named = {split: [found[split].get(k, f"{k:05d}") for k in INDICES[split]] for split in INDICES}
        return {"train": named["train"], "validation": named["minival"], "test": named["val"]}

    def full_name(self, name: str, known: Sequence[str]) -> str:
        """The full name of a building, given its index or its id."""
        return next((full for full in known if name in (full[:5], full[6:])), name)

    def files(self, folder: Path, name: str) -> ScanFiles:
        """The building's files in the first split folder that contains it."""
        index = int(name[:5])
        splits = [split for split, indices in INDICES.items() if index in indices]
        scenes = [folder / split / (name if name[5:] else f"{name}-*") for split in splits]
        stem = _scan_id(name)
        scenes.sort(key=lambda scene: (not (scene / f"{stem}.glb").is_file(), not scene.is_dir()))
        scene = scenes[0]
        plain, basis = scene / f"{stem}.glb", scene / f"{stem}.basis.glb"
        return ScanFiles(
            plain if plain.is_file() or not basis.is_file() else basis,
            (scene / f"{stem}.semantic.txt", scene / f"{stem}.semantic.glb"),
            (basis, scene / f"{stem}.basis.navmesh") if plain.is_file() else (scene / f"{stem}.basis.navmesh",),
        )


def read_instances(path: Path) -> dict[int, tuple[int, str]]:
    """Read a .semantic.txt: the id and the category of each instance, by its colour 0xRRGGBB.

    The first line is the header; each further line is `id,HEXRGB,"category",region`.

    Raises:
        DeuxError: the file cannot be read, or a line does not have this format.
    """
    try:
        with path.open(encoding="utf-8", newline="") as file:
            if HEADER not in (first := file.readline()):
                raise DeuxError(f"{path} begins with {shown(first.strip())}: a .semantic.txt begins with {HEADER!r}.")
            lines = [(k, fields) for k, fields in enumerate(csv.reader(file), start=2) if fields]
    except (OSError, UnicodeDecodeError) as error:
        raise DeuxError(f"{path} cannot be read: {error}.") from error
    instances = {}
    for number, fields in lines:
        try:
            instances[int(fields[1], 16)] = (int(fields[0]), fields[2].strip())
        except (ValueError, IndexError) as error:
            raise DeuxError(f'line {number} of {path} is not id,HEXRGB,"category",region: {error}.') from error
    return instances


def _found(folder: Path) -> dict[int, str]:
    """The scene folders in a folder, by index."""
    if not folder.is_dir():
        return {}
    return {int(match[1]): match[0] for path in folder.iterdir() if (match := SCENE_FOLDER.fullmatch(path.name))}


def _scan_id(name: str) -> str:
    return name[6:] or "*"  # only the index is known of a scene that is not on disk


def _colors(mesh: SceneMesh, owner: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Colours of points on faces without interpolation, P x 3 uint8: the nearest texel, or the nearest corner's colour.

    Args:
        mesh: the mesh, whose textures or vertex colours encode instances.
        owner: P, the face of each point.
        weights: P x 3, the points' barycentric coordinates.
    """
    colors = np.zeros((len(owner), 3), np.uint8)
    if mesh.vertex_colors is not None:
        corner = mesh.faces[owner, weights.argmax(axis=1)]
        colors = mesh.vertex_colors[corner]
    uv = np.einsum("pk,pkd->pd", weights, mesh.uv[owner])
    for index, material in enumerate(mesh.materials):
        if (texture := material.texture) is not None:
            own = mesh.face_material[owner] == index
            u, v = uv[own].T % 1.0
            height, width = texture.shape[:2]
            rows = np.minimum(((1.0 - v) * height).astype(np.int64), height - 1)
            columns = np.minimum((u * width).astype(np.int64), width - 1)
            colors[own] = texture[rows, columns]
    return colors
