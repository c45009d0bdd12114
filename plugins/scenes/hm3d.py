"""The scene source `hm3d`: Habitat-Matterport 3D, 1000 scanned buildings, with the labels of each instance."""

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
"""The scenes of each of the set's folders; those of minival are also in val."""

SCENE_FOLDER = re.compile(r"(\d{5})-(\w{11})")

HEADER = "HM3D Semantic Annotations"

NOTHING_KNOWN = ("unknown", "unannotated", "unlabeled", "")
"""Categories that say nothing of a surface."""


@dataclass(frozen=True)
class HM3DReference(ScanReference):
    """A building of HM3D; `annotation` is its .semantic.txt and its .semantic.glb.

    `path` is the .glb whose textures are JPEG or PNG images or, where that is not there, the .basis.glb.
    """

    @property
    def file(self) -> Path:
        """The .basis.glb, to which the set's navigation meshes and configurations belong, if it is there."""
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
                f"{str(error).rstrip('.')}; HM3D's archives whose names have _glb or -glb in them hold "
                f"{_scan_id(self.name)}.glb, whose textures are plain images: put it into the same folder."
            ) from error

    def surface(self) -> LabelledSurface:
        """The surfaces of the semantic mesh, whose colours are those of the listed instances."""
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
    """Habitat-Matterport 3D (HM3D): 1000 scanned buildings; of some of them every object is labelled.

    The layout is `hm3d/{train,val,minival}/<index>-<id>/<id>.glb`, or `<id>.basis.glb` for simulators that read it
    themselves, with `<id>.semantic.glb` and `<id>.semantic.txt` for the labels. The splits are the folders': 800
    buildings to train on, minival's 10 to validate and val's 100 to test, as in the DEUX paper. Since minival's are
    also in val, a test set leaves out those that validate, which leaves 90.

    Args:
        root: the folder that holds train, val and minival, or the folder above it.
        train: number of buildings that are explored, null for all of the split, or a list of indices ("00800"), ids
            or both ("00800-TEEsavR23oF").
        validation: likewise, of buildings that choose between models.
        test: likewise, of buildings that are kept for the final numbers.
        limit: at most so many buildings of each split, the first ones; null for no limit.
        labels: whether surfaces get the set's labels, where they are on disk.
        max_texture: the most pixels that the longer side of a texture keeps; null for all.
        prepared: a folder in which a scene is kept as it is used once it was read, as of `scenes=files`.
        floor: "largest" for the floor with the most room, "all" for an episode on each, or a number from the lowest, 0.
        region: x_min, z_min, x_max and z_max in world metres that the robot stays within; null for no bound.
        start: x and z in world metres of a point whose connected floor is taken; null for the largest one.

    Raises:
        DeuxError: a building is missing, incomplete or in two splits.
    """

    title = "HM3D"
    source = "HM3D's home page (aihabitat.org/datasets/hm3d) offers them as hm3d-{train,val,minival}-glb-v0.2.tar"
    layout = "train, val or minival with folders such as 00800-TEEsavR23oF in it"
    folders = ("hm3d",)
    reference_type = HM3DReference

    def is_folder(self, folder: Path) -> bool:
        """Whether it has a split with a building in it."""
        return any(_found(folder / split) for split in INDICES)

    def names(self, folder: Path) -> dict[str, list[str]]:
        """The folders of each split by index, or the index alone where there is none."""
        found = {split: _found(folder / split) for split in INDICES}
        found["minival"] = found["val"] | found["minival"]
        named = {split: [found[split].get(k, f"{k:05d}") for k in INDICES[split]] for split in INDICES}
        return {"train": named["train"], "validation": named["minival"], "test": named["val"]}

    def full_name(self, name: str, known: Sequence[str]) -> str:
        """The building of an index or of an id."""
        return next((full for full in known if name in (full[:5], full[6:])), name)

    def files(self, folder: Path, name: str) -> ScanFiles:
        """The building's files in the first of the splits' folders that has it."""
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
    """Read a .semantic.txt: the number and the category of each instance, by its colour as a number 0xRRGGBB.

    The first line names the format; each further one is `id,HEXRGB,"category",region`.

    Raises:
        DeuxError: the file cannot be read, or a line is none of the format.
    """
    try:
        with path.open(encoding="utf-8", newline="") as file:
            if HEADER not in (first := file.readline()):
                raise DeuxError(f"{path} begins with {shown(first.strip())}, but a .semantic.txt does with {HEADER!r}.")
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
    return name[6:] or "*"  # of a scene that is not there nothing is known but its index


def _colors(mesh: SceneMesh, owner: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """The colours, P x 3 uint8, of points in faces: the texel below each, or the colour of the nearest corner.

    Args:
        mesh: unlit; its textures and vertex colours are exact, so that nothing is interpolated.
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
