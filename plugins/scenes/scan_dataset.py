"""The base class of the sources of published scan datasets: finds their folder, selects scenes and reads labels."""

from __future__ import annotations

import functools
import hashlib
import logging
import os
from abc import abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import chain, islice
from pathlib import Path
from typing import ClassVar, Literal

from deux.contracts import Scene, SceneArea, SceneFiles, SceneReference, SceneSource, SceneSplits
from deux.errors import DeuxError, check_range, near_matches
from deux.mesh_files.mesh_reader import Up
from deux.scenes.splits import SPLITS, check_disjoint, make_splits
from deux_plugins.scenes.files import FileReference
from deux_plugins.scenes.surface_labels import LabelledSurface

BLOCK = 2**16
BLOCKS = 16
"""Bytes of a block, and number of blocks of a file, that are hashed: hashing whole datasets would take too long."""

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class ScanReference(FileReference):
    """A scene of a published dataset: its mesh file, and the files of its labels.

    Args:
        name: the scene's name.
        path: the mesh file, absolute.
        up: the axis of the file that points up.
        annotation: the files of the labels; empty if there are none or they are not wanted.
    """

    up: Up = "z"
    annotation: tuple[Path, ...] = ()

    @property
    def identity(self) -> str:
        """The hash of samples of the content of all its files, independent of their paths."""
        # The folder of an .obj file contains only its materials and textures.
        together = self.path.parent.iterdir() if self.path.suffix == ".obj" else [self.path]
        mesh = sorted(path for path in together if path.is_file())
        hashes = [_sampled_hash(p, p.stat().st_size, p.stat().st_mtime_ns) for p in (*mesh, *self.annotation)]
        content = hashlib.sha256("".join(hashes).encode()).hexdigest()[:16]
        return f"scan:{content}" + ("" if self.max_texture is None else f":textures{self.max_texture}")

    def load(self) -> Scene:
        """Read the mesh, and label its faces if there are labels."""
        scene = super().load()
        if self.annotation:
            try:
                surface = self.surface()
            except DeuxError as error:
                raise DeuxError(f"{str(error).rstrip('.')}; set scenes.labels=false to ignore the labels.") from error
            scene = replace(scene, mesh=surface.label(scene.mesh, self.name))
        return replace(scene, identity=self.identity)

    def surface(self) -> LabelledSurface:
        """The labelled surfaces of the scene, read from `annotation`.

        Raises:
            DeuxError: the files cannot be read.
        """
        raise NotImplementedError


@dataclass(frozen=True)
class ScanFiles:
    """The expected files of one scene, whether or not they exist.

    Args:
        mesh: the mesh file.
        annotation: all files of the labels; empty if the dataset has no labels.
        others: further files of the scene that are not read, such as its navigation mesh.
    """

    mesh: Path
    annotation: tuple[Path, ...] = ()
    others: tuple[Path, ...] = ()

    @property
    def fault(self) -> str:
        """The problem with the mesh file, for the end of a sentence; "" if there is none."""
        if not self.mesh.parent.is_dir():
            return f"there is no folder {self.mesh.parent}"
        if not self.mesh.is_file():
            return f"there is no {self.mesh.name} in {self.mesh.parent}"
        size = self.mesh.stat().st_size
        if self.mesh.suffix == ".glb" and size < (whole := _glb_length(self.mesh)):
            return f"{self.mesh} is truncated after {size} of {whole} bytes"
        return "" if size else f"{self.mesh} is empty"

    @property
    def labelled(self) -> bool:
        """Whether all files of the labels exist."""
        return bool(self.annotation) and all(path.is_file() for path in self.annotation)


class ScanDataset(SceneSource):
    """The base class of published scan datasets in their own folder layout.

    Args:
        root: the dataset's folder, or its parent.
        train: number of scenes to explore, None for all of the split, or a list of scenes.
        validation: likewise, for model selection.
        test: likewise, for the final evaluation.
        limit: greatest number of scenes in each split, from its beginning; None for no limit.
        labels: whether to read the dataset's labels, if they are on disk.
        max_texture: greatest size in pixels of a texture's longer side; larger textures are halved; None for no limit.
        prepared: the folder in which prepared scenes are cached, see `Files`; None for none.
        floor: see `SceneArea`.
        region: see `SceneArea`.
        start: see `SceneArea`.
    """

    title: ClassVar[str]
    """The dataset's name, for messages."""

    source: ClassVar[str]
    """Where to download the files, for the end of a sentence."""

    layout: ClassVar[str]
    """The contents of the dataset's folder, for messages."""

    folders: ClassVar[tuple[str, ...]]
    """Usual names of the dataset's folder."""

    reference_type: ClassVar[type[ScanReference]] = ScanReference
    """The type of references to scenes; datasets with labels have their own."""

    def __init__(
        self,
        root: str,
        train: int | list[str] | None = None,
        validation: int | list[str] | None = None,
        test: int | list[str] | None = None,
        limit: int | None = None,
        labels: bool = True,
        max_texture: int | None = None,
        prepared: str | None = None,
        floor: int | Literal["largest", "all"] = "largest",
        region: tuple[float, float, float, float] | None = None,
        start: tuple[float, float] | None = None,
    ) -> None:
        self._asked = dict(zip(SPLITS, (train, validation, test), strict=True))
        for split, asked in self._asked.items():
            if isinstance(asked, int):
                check_range(f"scenes.{split}", asked, 0)
        if limit is not None:
            check_range("scenes.limit", limit, 1)
        if max_texture is not None:
            check_range("scenes.max_texture", max_texture, 1)
        self._limit = limit
        self._max_texture = max_texture
        self._prepared = None if prepared is None else Path(os.path.abspath(Path(prepared).expanduser()))
        self._labels = labels
        self._area = SceneArea(floor, region, start)
        self._root = root

    @property
    def folder(self) -> Path:
        """The dataset's folder.

        Raises:
            DeuxError: it is not found in the root.
        """
        return find_folder(self._root, self)

    @abstractmethod
    def is_folder(self, folder: Path) -> bool:
        """Whether a folder looks like the dataset's folder."""

    @abstractmethod
    def names(self, folder: Path) -> dict[str, list[str]]:
        """The scenes of each split of a complete download, in order; a number of scenes selects the first ones."""

    @abstractmethod
    def files(self, folder: Path, name: str) -> ScanFiles:
        """The expected files of a scene."""

    def full_name(self, name: str, known: Sequence[str]) -> str:
        """The full name of a scene, given a name or an abbreviation; `name` itself if there is no such scene."""
        return name

    def splits(self) -> SceneSplits:
        """The requested scenes.

        Raises:
            DeuxError: the folder or a scene is missing, there are fewer than requested, or a scene is in two splits.
        """
        folder = self.folder
        names = self.names(folder)
        chosen: dict[str, list[str]] = {}
        for split in SPLITS:
            # If the dataset's splits overlap, as in HM3D, validation scenes are excluded from the test.
            used = set(chosen.get("validation", ())) & set(names["validation"]) if split == "test" else set()
            pool = [name for name in names[split] if name not in used]
            if len(pool) < len(names[split]) and not isinstance(self._asked[split], list):
                log.info("%s: %d test scenes are used for validation and excluded from test.", self.title, len(used))
            chosen[split] = self._choose(split, pool, names)[: self._limit]
        check_disjoint(chosen, "scene")
        return make_splits({split: self._references(folder, split, names) for split, names in chosen.items()})

    def inventory(self) -> dict[str, tuple[SceneFiles, ...]]:
        """The files on disk of all scenes of the dataset, by split."""
        folder = self.folder
        return {
            split: tuple(_on_disk(name, self.files(folder, name)) for name in names)
            for split, names in self.names(folder).items()
        }

    def _choose(self, split: str, pool: list[str], names: dict[str, list[str]]) -> list[str]:
        asked = self._asked[split]
        if isinstance(asked, list):
            known = list(dict.fromkeys(name for split in SPLITS for name in names[split]))
            return [self._known(split, name, known) for name in asked]
        if asked is not None and asked > len(pool):
            raise DeuxError(
                f"scenes.{split} is {asked}, but {self.title} has only {len(pool)} scenes for it in {self.folder}."
            )
        return pool[:asked]

    def _known(self, split: str, name: str, known: Sequence[str]) -> str:
        full = self.full_name(name, known)
        if full not in known:
            matches = near_matches(name, known) if len(known) <= 100 else "it has too many to list them."
            raise DeuxError(f"scenes.{split} lists {name}, which is not a scene of {self.title}: {matches}")
        return full

    def _references(self, folder: Path, split: str, names: Sequence[str]) -> list[SceneReference]:
        found = [(name, self.files(folder, name)) for name in names]
        faults = [f"{name}, {fault}" for name, scan in found if (fault := scan.fault)]
        if faults:
            raise DeuxError(
                f"{len(faults)} of the {len(names)} scenes of scenes.{split} are missing or incomplete, first "
                f"{faults[0]}: {self.source}, with its licence; python -m deux.doctor lists all missing files."
            )
        return [self._reference(name, scan) for name, scan in found]

    def _reference(self, name: str, scan: ScanFiles) -> ScanReference:
        annotation = scan.annotation if self._labels and scan.labelled else ()
        return self.reference_type(
            name,
            scan.mesh,
            max_texture=self._max_texture,
            prepared=self._prepared,
            annotation=annotation,
            area=self._area,
        )


def find_folder(root: str | Path, dataset: ScanDataset) -> Path:
    """Find the folder of a dataset: `root`, or a folder in it with one of the dataset's usual names.

    Raises:
        DeuxError: there is no such folder; the message names a folder nearby that looks right.
    """
    root = Path(os.path.abspath(Path(root).expanduser()))
    if not root.is_dir():
        raise DeuxError(f"scenes.root is {root}, but there is no such folder: give the folder of {dataset.title}.")
    for folder in (root, *(root / name for name in dataset.folders)):
        if folder.is_dir() and dataset.is_folder(folder):
            return folder
    if near := _nearby(root, dataset.is_folder):
        raise DeuxError(f"scenes.root is {root}, at the wrong level: {near} looks like {dataset.title}'s folder.")
    raise DeuxError(
        f"scenes.root is {root}, which does not look like {dataset.title}'s folder: it contains {dataset.layout}; "
        f"{dataset.source}, with its licence."
    )


def _nearby(root: Path, is_folder: Callable[[Path], bool]) -> Path | None:
    """A folder up to two levels above or three levels below `root` that looks right."""
    below = (islice(root.glob(pattern), 300) for pattern in ("*/", "*/*/", "*/*/*/"))  # limited: root may be a home
    for folder in chain(list(root.parents)[:2], *below):
        try:
            if is_folder(folder):
                return folder
        except PermissionError:
            continue
    return None


def _on_disk(name: str, scan: ScanFiles) -> SceneFiles:
    there = tuple(path for path in (scan.mesh, *scan.annotation, *scan.others) if path.is_file())
    absent = tuple(path.name for path in scan.annotation if not path.is_file())
    return SceneFiles(
        name,
        there,
        missing=(scan.fault,) if scan.fault else (),
        without=(f"labels ({' and '.join(absent)})",) if absent else (),
    )


@functools.cache
def _sampled_hash(path: Path, size: int, modified: int) -> str:
    """The hash of a file's size and of evenly spaced blocks of it, which suffices for published files.

    Size and modification time are part of the cache's key.
    """
    digest = hashlib.sha256(str(size).encode())
    with path.open("rb") as file:
        last = max(size - BLOCK, 0)
        for k in range(BLOCKS):
            file.seek(k * last // (BLOCKS - 1))
            digest.update(file.read(BLOCK))
    return digest.hexdigest()


def _glb_length(path: Path) -> int:
    """The length in bytes according to the header of a .glb file; 0 without such a header."""
    with path.open("rb") as file:
        start = file.read(12)
    return int.from_bytes(start[8:12], "little") if start[:4] == b"glTF" else 0
