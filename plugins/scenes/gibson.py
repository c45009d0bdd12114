"""The scene source `gibson`: the Gibson Database of scanned buildings, in Habitat-Sim's flat folder."""

import csv
import hashlib
import logging
import os
from pathlib import Path
from typing import Literal

from deux.contracts import SceneSplits
from deux.errors import DeuxError
from deux_plugins.scenes.scan_dataset import ScanDataset, ScanFiles

SPLIT_COLUMNS = {"train": ("train",), "validation": ("val", "validation"), "test": ("test",)}
"""The columns of the set's split files that stand for each split."""

HELD_OUT = 0.1  # of the buildings for validation, and as many for the test, where no split file is given

log = logging.getLogger(__name__)


class Gibson(ScanDataset):
    """The Gibson Database: 572 scanned buildings, each one textured mesh, without labels.

    The layout is Habitat-Sim's, a flat folder `gibson/<Scene>.glb`. The splits come from one of the set's own lists,
    such as train_val_test_fullplus.csv, a table with a column `id` and the columns `train`, `val` and `test` of 0 and
    1. Without a list all buildings that are there are one pool, in an order drawn by `split_seed`, of which a tenth
    validates and a tenth tests.

    Args:
        root: the folder that holds the .glb files, or the folder above it.
        train: number of buildings that are explored, null for all of the split, or a list of names.
        validation: likewise, of buildings that choose between models.
        test: likewise, of buildings that are kept for the final numbers.
        split_file: one of the set's own lists of the splits, relative to the working folder; null for a drawn split.
        split_seed: seed of the drawn split.
        limit: at most so many buildings of each split, the first ones; null for no limit.
        max_texture: the most pixels that the longer side of a texture keeps; null for all.
        prepared: a folder in which a scene is kept as it is used once it was read, as of `scenes=files`.
        floor: "largest" for the floor with the most room, "all" for an episode on each, or a number from the lowest, 0.
        region: x_min, z_min, x_max and z_max in world metres that the robot stays within; null for no bound.
        start: x and z in world metres of a point whose connected floor is taken; null for the largest one.

    Raises:
        DeuxError: a building is missing, incomplete or in two splits.
    """

    title = "Gibson"
    source = "the Gibson Database (gibsonenv.stanford.edu/database) offers them for Habitat-Sim"
    layout = "<Scene>.glb for names such as Adrian"
    folders = ("gibson",)

    def __init__(
        self,
        root: str,
        train: int | list[str] | None = None,
        validation: int | list[str] | None = None,
        test: int | list[str] | None = None,
        split_file: str | None = None,
        split_seed: int = 0,
        limit: int | None = None,
        max_texture: int | None = None,
        prepared: str | None = None,
        floor: int | Literal["largest", "all"] = "largest",
        region: tuple[float, float, float, float] | None = None,
        start: tuple[float, float] | None = None,
    ) -> None:
        super().__init__(root, train, validation, test, limit, False, max_texture, prepared, floor, region, start)
        self._split_file = split_file
        self._split_seed = split_seed

    def is_folder(self, folder: Path) -> bool:
        """Whether there are .glb files in it."""
        return any(folder.glob("*.glb"))

    def names(self, folder: Path) -> dict[str, list[str]]:
        """The splits of the split file, or drawn ones."""
        if self._split_file is not None:
            return read_split_file(Path(os.path.abspath(Path(self._split_file).expanduser())))
        pool = sorted((path.stem for path in folder.glob("*.glb")), key=self._place)
        count = max(1, round(HELD_OUT * len(pool)))
        return {"train": pool[2 * count :], "validation": pool[count : 2 * count], "test": pool[:count]}

    def splits(self) -> SceneSplits:
        """The buildings that are asked for; a drawn split is said."""
        if self._split_file is None:
            names = self.names(folder := self.folder)
            log.warning(
                "Gibson: the split of the buildings in %s is drawn by scenes.split_seed=%d, since there is no "
                "scenes.split_file: %d train, %d validation, %d test.",
                folder,
                self._split_seed,
                *(len(names[split]) for split in SPLIT_COLUMNS),
            )
        return super().splits()

    def files(self, folder: Path, name: str) -> ScanFiles:
        """The building's mesh, and its navigation mesh."""
        return ScanFiles(folder / f"{name}.glb", (), (folder / f"{name}.navmesh",))

    def _place(self, name: str) -> str:
        # By hash and not by shuffling: a building that is added leaves the order of the others as it is.
        return hashlib.sha256(f"{self._split_seed}:{name}".encode()).hexdigest()


def read_split_file(path: Path) -> dict[str, list[str]]:
    """Read a list of the splits: a .csv table with a column `id` and columns `train`, `val` and `test` of 0 and 1.

    Raises:
        DeuxError: the file is missing or no such table.
    """
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            rows = list(csv.DictReader(file, skipinitialspace=True))
    except (OSError, UnicodeDecodeError) as error:
        raise DeuxError(f"scenes.split_file is {path}, which cannot be read: {error}.") from error
    columns = set(rows[0]) if rows else set()
    if "id" not in columns or not {"train", "test"} <= columns or not {"val", "validation"} & columns:
        raise DeuxError(f"scenes.split_file is {path}, which is no table with the columns id, train, val and test.")
    return {
        split: [row["id"].strip() for row in rows if any((row.get(c) or "").strip() == "1" for c in chosen)]
        for split, chosen in SPLIT_COLUMNS.items()
    }
