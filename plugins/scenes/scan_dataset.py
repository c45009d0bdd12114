"""What the sources of published scans share: where a set lies on disk, which scenes are asked for, and their labels."""

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
"""Bytes of a block, and blocks of a file, that tell it from others: sets of 100 GB are not read to know them."""

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class ScanReference(FileReference):
    """A scene of a published set: its mesh file, and the files of its labels.

    Args:
        name: the scene's name.
        path: the mesh file, absolute.
        up: the axis of the file that points up.
        annotation: the files that label the surfaces; none where the set has no labels or they are not wanted.
    """

    up: Up = "z"
    annotation: tuple[Path, ...] = ()

    @property
    def identity(self) -> str:
        """The hash of samples of the content of all its files, wherever they lie."""
        # An .obj file has its materials and textures beside it, in a folder of its own.
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
                raise DeuxError(f"{str(error).rstrip('.')}; scenes.labels=false leaves the labels out.") from error
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
    """Where the files of one scene are expected, whether or not they are there.

    Args:
        mesh: the file that is loaded.
        annotation: the files that its labels need, all of them; none where the set has no labels.
        others: further files of the scene, such as its navigation mesh; nothing here reads them.
    """

    mesh: Path
    annotation: tuple[Path, ...] = ()
    others: tuple[Path, ...] = ()

    @property
    def fault(self) -> str:
        """What is wrong with the mesh file, the end of a sentence; "" where nothing is."""
        if not self.mesh.parent.is_dir():
            return f"there is no folder {self.mesh.parent}"
        if not self.mesh.is_file():
            return f"there is no {self.mesh.name} in {self.mesh.parent}"
        size = self.mesh.stat().st_size
        if self.mesh.suffix == ".glb" and size < (whole := _glb_length(self.mesh)):
            return f"{self.mesh} is cut off after {size} of {whole} bytes"
        return "" if size else f"{self.mesh} is empty"

    @property
    def labelled(self) -> bool:
        """Whether there are labels."""
        return bool(self.annotation) and all(path.is_file() for path in self.annotation)


class ScanDataset(SceneSource):
    """The scenes of a published set in its own folder layout. A subclass says which they are and where.

    Args:
        root: the set's folder, or the folder above it.
        train: number of scenes that are explored, None for all of the split, or a list of scenes.
        validation: likewise, of scenes that choose between models.
        test: likewise, of scenes that are kept for the final numbers.
        limit: at most so many scenes of each split, the first ones; None for no limit.
        labels: whether surfaces get the set's labels, where they are on disk.
        max_texture: the most pixels that the longer side of a texture keeps; None for all.
        prepared: the folder in which scenes are kept as they are used, as of `files`; None keeps nothing.
        floor: the floor that the robot lives on, as of `SceneArea`.
        region: the part of it, as of `SceneArea`.
        start: a point of it, as of `SceneArea`.
    """

    title: ClassVar[str]
    """The set's name, for messages."""

    source: ClassVar[str]
    """Where the files are to be had, the end of a sentence."""

    layout: ClassVar[str]
    """What the set's folder holds, for messages."""

    folders: ClassVar[tuple[str, ...]]
    """Names of the set's folder below the folder above it."""

    reference_type: ClassVar[type[ScanReference]] = ScanReference
    """The locator of a scene; one of the set's own where there are labels."""

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
        """The set's folder.

        Raises:
            DeuxError: it is not in the root.
        """
        return find_folder(self._root, self)

    @abstractmethod
    def is_folder(self, folder: Path) -> bool:
        """Whether a folder looks like the set's."""

    @abstractmethod
    def names(self, folder: Path) -> dict[str, list[str]]:
        """The scenes of each split of a complete download, in the order in which a number takes them."""

    @abstractmethod
    def files(self, folder: Path, name: str) -> ScanFiles:
        """Where the files of a scene are."""

    def full_name(self, name: str, known: Sequence[str]) -> str:
        """The name of the scene that a list calls `name`, or `name` itself if there is none."""
        return name

    def splits(self) -> SceneSplits:
        """The scenes that are asked for.

        Raises:
            DeuxError: the folder or a scene is missing, there are fewer than asked for, or one is in two splits.
        """
        folder = self.folder
        names = self.names(folder)
        chosen: dict[str, list[str]] = {}
        for split in SPLITS:
            # Where a set's own splits overlap, as HM3D's do, what validates does not test.
            used = set(chosen.get("validation", ())) & set(names["validation"]) if split == "test" else set()
            pool = [name for name in names[split] if name not in used]
            if len(pool) < len(names[split]) and not isinstance(self._asked[split], list):
                log.info("%s: %d scenes of test serve for validation and are left out.", self.title, len(used))
            chosen[split] = self._choose(split, pool, names)[: self._limit]
        check_disjoint(chosen, "scene")
        return make_splits({split: self._references(folder, split, names) for split, names in chosen.items()})

    def inventory(self) -> dict[str, tuple[SceneFiles, ...]]:
        """What is on disk of all scenes of the set."""
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
                f"scenes.{split} asks for {asked} scenes, but {self.title} has {len(pool)} for it in {self.folder}."
            )
        return pool[:asked]

    def _known(self, split: str, name: str, known: Sequence[str]) -> str:
        full = self.full_name(name, known)
        if full not in known:
            matches = near_matches(name, known) if len(known) <= 100 else "it has too many to list them."
            raise DeuxError(f"scenes.{split} lists {name}, which is no scene of {self.title}: {matches}")
        return full

    def _references(self, folder: Path, split: str, names: Sequence[str]) -> list[SceneReference]:
        found = [(name, self.files(folder, name)) for name in names]
        faults = [f"{name}, {fault}" for name, scan in found if (fault := scan.fault)]
        if faults:
            raise DeuxError(
                f"{len(faults)} of the {len(names)} scenes of scenes.{split} are missing or incomplete, first "
                f"{faults[0]}: {self.source}, with its licence; python -m deux.doctor lists all that is missing."
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
    """The folder of a set: `root`, or one below it that has one of the set's names.

    Raises:
        DeuxError: neither looks like the set's; the message names a folder near by that does.
    """
    root = Path(os.path.abspath(Path(root).expanduser()))
    if not root.is_dir():
        raise DeuxError(f"scenes.root is {root}, but there is no such folder: it must be {dataset.title}'s.")
    for folder in (root, *(root / name for name in dataset.folders)):
        if folder.is_dir() and dataset.is_folder(folder):
            return folder
    if near := _nearby(root, dataset.is_folder):
        raise DeuxError(f"scenes.root is {root}, at the wrong level: {near} looks like {dataset.title}'s folder.")
    raise DeuxError(
        f"scenes.root is {root}, which does not look like {dataset.title}'s folder: that holds {dataset.layout}; "
        f"{dataset.source}, with its licence."
    )


def _nearby(root: Path, is_folder: Callable[[Path], bool]) -> Path | None:
    """A folder up to two levels above or three below `root` that looks right."""
    below = (islice(root.glob(pattern), 300) for pattern in ("*/", "*/*/", "*/*/*/"))  # a home folder has too many
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
    """The hash of a file's size and of blocks spread evenly over it; of all its content where that is small.

    That is enough for published files, which nobody edits. Size and time are there for the cache.
    """
    digest = hashlib.sha256(str(size).encode())
    with path.open("rb") as file:
        last = max(size - BLOCK, 0)
        for k in range(BLOCKS):
            file.seek(k * last // (BLOCKS - 1))
            digest.update(file.read(BLOCK))
    return digest.hexdigest()


def _glb_length(path: Path) -> int:
    """The length in bytes that the header of a .glb file states; 0 where it has none."""
    with path.open("rb") as file:
        start = file.read(12)
    return int.from_bytes(start[8:12], "little") if start[:4] == b"glTF" else 0
