"""The scene source `replica`: the Replica dataset, 18 scanned rooms and flats, with the label of each instance."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from deux.errors import DeuxError
from deux.io.json_files import read_json_object
from deux_plugins.scenes.scan_dataset import ScanDataset, ScanFiles, ScanReference
from deux_plugins.scenes.surface_labels import LabelledSurface, labelled_surface, look_up, read_annotated_ply

SPLIT_NAMES = {
    "train": [
        *("apartment_0", "apartment_1", "office_0", "office_1", "office_2", "room_0", "room_1"),
        *(f"frl_apartment_{k}" for k in range(6)),
    ],
    "validation": ["hotel_0"],
    "test": ["apartment_2", "office_3", "office_4", "room_2"],
}
"""Splits of our own, since the set has none. The six frl_apartments are one flat, furnished six times."""


@dataclass(frozen=True)
class ReplicaReference(ScanReference):
    """A scene of Replica; `annotation` is habitat/mesh_semantic.ply and habitat/info_semantic.json."""

    def surface(self) -> LabelledSurface:
        """The annotated faces, labelled with the set's classes."""
        ply, listing = self.annotation
        class_of_object = read_objects(listing)
        triangles, properties = read_annotated_ply(ply)
        if "object_id" not in properties:
            raise DeuxError(f"{ply} has no object_id on its faces: it is no annotation of Replica's.")
        objects = properties["object_id"].astype(np.int64)
        names = tuple(sorted(set(class_of_object.values())))
        numbers = {number: names.index(name) for number, name in class_of_object.items()}
        return labelled_surface(triangles, look_up(numbers, objects), objects, names)


class Replica(ScanDataset):
    """Replica: 18 scanned rooms and flats of high quality, every object labelled.

    The layout is `<scene>/mesh.ply`, with `<scene>/habitat/mesh_semantic.ply` and `info_semantic.json` for the labels.
    Colours are those of the vertices; the set's textures, in a format of its own, are not read. The set has no splits;
    these are: hotel_0 validates, apartment_2, office_3, office_4 and room_2 test, the other 13 train.

    Args:
        root: the folder that holds one folder for each scene, or the folder above it.
        train: number of scenes that are explored, null for all of the split, or a list of names.
        validation: likewise, of scenes that choose between models.
        test: likewise, of scenes that are kept for the final numbers.
        limit: at most so many scenes of each split, the first ones; null for no limit.
        labels: whether surfaces get the set's labels, where they are on disk.
        max_texture: the most pixels that the longer side of a texture keeps; null for all.
        prepared: a folder in which a scene is kept as it is used once it was read, as of `scenes=files`.
        floor: "largest" for the floor with the most room, "all" for an episode on each, or a number from the lowest, 0.
        region: x_min, z_min, x_max and z_max in world metres that the robot stays within; null for no bound.
        start: x and z in world metres of a point whose connected floor is taken; null for the largest one.

    Raises:
        DeuxError: a scene is missing, incomplete or in two splits.
    """

    title = "Replica"
    source = "the repository facebookresearch/Replica-Dataset has the script that downloads them"
    layout = "<scene>/mesh.ply for names such as room_0"
    folders = ("replica", "replica_v1", "Replica", "Replica-Dataset")
    reference_type = ReplicaReference

    def is_folder(self, folder: Path) -> bool:
        """Whether it has a folder that is named like a scene."""
        return any((folder / name).is_dir() for names in SPLIT_NAMES.values() for name in names)

    def names(self, folder: Path) -> dict[str, list[str]]:
        """The splits."""
        return SPLIT_NAMES

    def files(self, folder: Path, name: str) -> ScanFiles:
        """The scene's files."""
        habitat = folder / name / "habitat"
        annotation = (habitat / "mesh_semantic.ply", habitat / "info_semantic.json")
        return ScanFiles(folder / name / "mesh.ply", annotation, (habitat / "mesh_semantic.navmesh",))


def read_objects(path: Path) -> dict[int, str]:
    """Read an info_semantic.json: the class of each object, by the object's number.

    Raises:
        DeuxError: the file is no such list.
    """
    try:
        return {int(entry["id"]): str(entry["class_name"]) for entry in read_json_object(path)["objects"]}
    except (DeuxError, ValueError, KeyError, TypeError, OverflowError) as error:
        raise DeuxError(f"{path} does not list objects with their id and class_name: {error}.") from error
