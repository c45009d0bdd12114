"""The scene source `mp3d`: Matterport3D, 90 scanned buildings with labels of 40 categories (mpcat40)."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from deux.errors import DeuxError
from deux_plugins.scenes.scan_dataset import ScanDataset, ScanFiles, ScanReference
from deux_plugins.scenes.surface_labels import LabelledSurface, labelled_surface, look_up, read_annotated_ply

_TRAIN = """
    17DRP5sb8fy 1LXtFkjw3qL 1pXnuDYAj8r 29hnd4uzFmX 5LpN3gDmAk7 5q7pvUzZiYa 759xd9YjKW5 7y3sRwLe3Va 82sE5b5pLXE
    8WUmhLawc2A aayBHfsNo7d ac26ZMwG7aT B6ByNegPMKs b8cTxDM8gDG cV4RVeZvu5T D7N2EKCX4Sj e9zR4mvMWw7 EDJbREhghzL
    GdvgFV5R1Z5 gTV8FGcVJC9 HxpKQynjfin i5noydFURQK JeFG25nYj2p JF19kD82Mey jh4fc5c5qoQ kEZ7cmS4wCh mJXqzFtmKg4
    p5wJjkQkbXX Pm6F8kyY3z2 pRbA3pwrgk9 PuKPg4mmafe PX4nDJXEHrG qoiz87JEwZ2 rPc6DW4iMge s8pcmisQ38h S9hNv5qa7GM
    sKLMLpTHeUy SN83YJsR3w2 sT4fr6TAbpF ULsKaCPVFJR uNb9QFRL6hY Uxmj2M2itWa V2XKFyX4ASd VFuaQ6m2Qom VVfe2KiqLaN
    Vvot9Ly1tCj vyrNrziPKCB VzqfbhrpDEA XcA2TqTSSAj 2n8kARJN3HM D7G3Y4RVNrH dhjEzFoUFzH E9uDoFAP3SH gZ6f7yhEvPG
    JmbYfDe2QKZ r1Q1Z4BcV1o r47D5H71a5s ur6pFq6Qu1A VLzqgDo317F YmJkqBEsHnH ZMojNkEp431"""
_VALIDATION = """
    2azQ1b91cZZ 8194nk5LbLH EU6Fwq7SyZv oLBMNvg9in8 QUCTc6BB5sX TbHJrupSAjP X7HyMhZNoso pLe4wQe7qrG x8F5xyUWy9e
    Z6MFQCViBuw zsNo4HB9uLZ"""
_TEST = """
    2t7WUuJeko7 5ZKStnWn8Zo ARNzJeq3xxb fzynW3qQPVF jtcxE69GiFV pa4otMbVnkk q9vSo1VnCiC rqfALeAoiTq UwV83HsGsw3
    wc2JMjhGNzB WYY7iVyf5p8 YFuZgdQ5vWj yqstnuAEVhm YVUC4YcDtcY gxdoqLR6rwA gYvKGZ5eRqb RPmz2sHmrrY
    Vt2qJdWjCF2"""

SPLIT_NAMES = {"train": _TRAIN.split(), "validation": _VALIDATION.split(), "test": _TEST.split()}
"""The splits of the dataset's benchmark: 61, 11 and 18 buildings."""

_CATEGORIES = """
    void wall floor chair door table picture cabinet cushion window sofa bed curtain chest_of_drawers plant sink
    stairs ceiling toilet stool towel mirror tv_monitor shower column bathtub counter fireplace lighting beam railing
    shelving blinds gym_equipment seating board_panel furniture appliances clothes objects misc unlabel"""

MPCAT40 = tuple(_CATEGORIES.split())
"""The names of the categories, by mpcat40 index."""

NOTHING_KNOWN = ("void", "unlabel")
"""Categories that count as unlabelled."""


@dataclass(frozen=True)
class House:
    """The annotation of one building, from its .house file.

    Args:
        category: the mpcat40 name of each object, by the object's index.
        object_of_segment: the index of the object to which each segment of the surface belongs, by the segment's id.
    """

    category: dict[int, str]
    object_of_segment: dict[int, int]


@dataclass(frozen=True)
class MP3DReference(ScanReference):
    """A building of Matterport3D; `annotation` is its .house file and the .ply file of its annotated faces."""

    def surface(self) -> LabelledSurface:
        """The annotated faces: of the `_semantic.ply` that Habitat-Sim uses, or of the original segmentation."""
        house_file, ply = self.annotation
        house = read_house(house_file)
        triangles, properties = read_annotated_ply(ply)
        if "object_id" in properties:
            objects = properties["object_id"].astype(np.int64)
        elif "material_id" in properties:  # the id of the segment, despite its name
            objects = look_up(house.object_of_segment, properties["material_id"])
        else:
            raise DeuxError(f"{ply} has neither object_id nor material_id on its faces: it is not an MP3D annotation.")
        numbers = {name: k for k, name in enumerate(MPCAT40) if name not in NOTHING_KNOWN}
        labels = look_up({k: numbers.get(name, -1) for k, name in house.category.items()}, objects)
        return labelled_surface(triangles, labels, objects, MPCAT40)


class MP3D(ScanDataset):
    """Matterport3D: 90 scanned buildings as textured meshes, labelled with 40 categories.

    Two layouts are supported: that of Habitat-Sim, `mp3d/<id>/<id>.glb` with `<id>.house` and `<id>_semantic.ply` for
    the labels, and the original, `v1/scans/<id>/matterport_mesh/*/*.obj` with `house_segmentations/<id>.house` and
    `<id>.ply`. The splits are those of the dataset's benchmark: 61 buildings for training, 11 for validation, 18 for
    test.

    Args:
        root: the folder that contains one folder for each building, or its parent.
        train: number of buildings to explore, null for all of the split, or a list of ids.
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

    title = "Matterport3D"
    source = "the habitat task archive of Matterport3D (niessner.github.io/Matterport) holds them"
    layout = "<id>/<id>.glb, or <id>/matterport_mesh of the original set, for ids such as 17DRP5sb8fy"
    folders = ("mp3d", "v1/scans", "scans")
    reference_type = MP3DReference

    def is_folder(self, folder: Path) -> bool:
        """Whether the folder contains a folder with the name of a building."""
        return any((folder / name).is_dir() for names in SPLIT_NAMES.values() for name in names)

    def names(self, folder: Path) -> dict[str, list[str]]:
        """The splits of the dataset's benchmark."""
        return SPLIT_NAMES

    def files(self, folder: Path, name: str) -> ScanFiles:
        """The files in Habitat-Sim's layout, unless there are only those of the original layout."""
        scene = folder / name
        habitat = ScanFiles(
            scene / f"{name}.glb",
            (scene / f"{name}.house", scene / f"{name}_semantic.ply"),
            (scene / f"{name}.navmesh",),
        )
        original = sorted(scene.glob("matterport_mesh/*/*.obj"))
        if habitat.mesh.is_file() or not original:
            return habitat
        segmented = scene / "house_segmentations"
        return ScanFiles(original[0], (segmented / f"{name}.house", segmented / f"{name}.ply"))


def read_house(path: Path) -> House:
    """Read the categories and objects of an ASCII .house file (format: data_organization.md of Matterport3D).

    These lines are used, of which only the first fields are shown:

        C category_index label_id label_name mpcat40_id mpcat40_name
        O object_index region_index category_index
        E segment_index object_index id

    Raises:
        DeuxError: the file cannot be read, or a line does not have the format.
    """
    names: dict[int, str] = {}
    category_of_object: dict[int, int] = {}
    object_of_segment: dict[int, int] = {}
    for number, (kind, *fields) in _lines(path):
        try:
            if kind == "C":
                names[int(fields[0])] = fields[4]
            elif kind == "O":
                category_of_object[int(fields[0])] = int(fields[2])
            elif kind == "E":
                object_of_segment[int(fields[2])] = int(fields[1])
        except (ValueError, IndexError) as error:
            raise DeuxError(f"line {number} of {path} is not a valid {kind} line of a .house file: {error}.") from error
    if not names or not category_of_object:
        raise DeuxError(f"{path} lists no categories or no objects: it is not a .house file or is truncated.")
    category = {k: names[index] for k, index in category_of_object.items() if index in names}
    return House(category, object_of_segment)


def _lines(path: Path) -> Iterator[tuple[int, list[str]]]:
    """The lines of a text file that are not empty: line number and fields."""
    try:
        with path.open(encoding="utf-8", errors="replace") as file:
            for number, line in enumerate(file, start=1):
                if fields := line.split():
                    yield number, fields
    except OSError as error:
        raise DeuxError(f"{path} cannot be read: {error.strerror}.") from error
