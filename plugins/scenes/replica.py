"""The scene source `replica`: the Replica dataset, 18 scanned rooms and flats with instance labels."""

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
"""Our splits: the dataset has none. The six frl_apartments are one flat with different furniture."""


@dataclass(frozen=True)
class ReplicaReference(ScanReference):
    """A scene of Replica; `annotation` is habitat/mesh_semantic.ply and habitat/info_semantic.json."""

    def surface(self) -> LabelledSurface:
        """The annotated faces, labelled with the dataset's classes."""
        ply, listing = self.annotation
        class_of_object = read_objects(listing)
        triangles, properties = read_annotated_ply(ply)
        if "object_id" not in properties:
            raise DeuxError(f"{ply} has no object_id on its faces: it is not a Replica annotation.")
        objects = properties["object_id"].astype(np.int64)
        names = tuple(sorted(set(class_of_object.values())))
        numbers = {number: names.index(name) for number, name in class_of_object.items()}
        return labelled_surface(triangles, look_up(numbers, objects), objects, names)


class Replica(ScanDataset):
    """Replica: 18 scanned rooms and flats of high quality, with a label for every object.

    The layout is `<scene>/mesh.ply`, with `<scene>/habitat/mesh_semantic.ply` and `info_semantic.json` for the labels.
    Colours are vertex colours; the dataset's textures, in a special format, are not read. The dataset has no splits;
    here hotel_0 is for validation, apartment_2, office_3, office_4 and room_2 are for test, and the other 13 scenes for
    training.

    Args:
        root: the folder that contains one folder for each scene, or its parent.
        train: number of scenes to explore, null for all of the split, or a list of names.
        validation: likewise, for model selection.
        test: likewise, for the final evaluation.
        limit: greatest number of scenes in each split, from its beginning; null for no limit.
        labels: whether to read the dataset's labels, if they are on disk.
        max_texture: greatest size in pixels of a texture's longer side; larger textures are halved; null for no limit.
        prepared: the folder in which prepared scenes are cached, see `scenes=files`; null for none.
        floor: "largest" for the floor with the most free space, "all" for an episode on each, or 0 (the lowest) and up.
        region: x_min, z_min, x_max and z_max in world metres, the bounds of the robot's centre; null for none.
        start: x and z in world metres of a point in the connected part of the floor to use; null for the largest.

    Raises:
        DeuxError: a scene is missing, incomplete or in two splits.
    """

    title = "Replica"
    source = "the repository facebookresearch/Replica-Dataset has the script that downloads them"
    layout = "<scene>/mesh.ply for names such as room_0"
    folders = ("replica", "replica_v1", "Replica", "Replica-Dataset")
    reference_type = ReplicaReference

    def is_folder(self, folder: Path) -> bool:
        """Whether the folder contains a folder with the name of a scene."""
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
    """Read an info_semantic.json: the class of each object, by the object's id.

    Raises:
        DeuxError: the file is not such a list.
    """
    try:
        return {int(entry["id"]): str(entry["class_name"]) for entry in read_json_object(path)["objects"]}
    except (DeuxError, ValueError, KeyError, TypeError, OverflowError) as error:
        raise DeuxError(f"{path} does not list objects with their id and class_name: {error}.") from error
