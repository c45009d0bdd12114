"""The scene source `gibson`: the Gibson Database of scanned buildings, in the layout of Habitat-Sim."""

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
"""The columns of the dataset's split files for each split."""

HELD_OUT = 0.1  # fraction of the buildings for validation, and as many for test, if no split file is given

log = logging.getLogger(__name__)


class Gibson(ScanDataset):
    """The Gibson Database: 572 scanned buildings, each one textured mesh, without labels.

    The layout is that of Habitat-Sim, a flat folder `gibson/<Scene>.glb`. The splits are read from one of the dataset's
    lists, such as train_val_test_fullplus.csv, a table with a column `id` and columns `train`, `val` and `test` of 0
    and 1. Without a list, the buildings on disk are shuffled by `split_seed`; a tenth is for validation and a tenth for
    test.

    Args:
        root: the folder that contains the .glb files, or its parent.
        train: number of buildings to explore, null for all of the split, or a list of names.
        validation: likewise, for model selection.
        test: likewise, for the final evaluation.
        split_file: one of the dataset's lists of splits, relative to the working folder; null for random splits.
        split_seed: seed of random splits.
        limit: greatest number of buildings in each split, from its beginning; null for no limit.
        max_texture: greatest size in pixels of a texture's longer side; larger textures are halved; null for no limit.
        prepared: the folder in which prepared scenes are cached, see `scenes=files`; null for none.
        floor: "largest" for the floor with the most free space, "all" for an episode on each, or 0 (the lowest) and up.
        region: x_min, z_min, x_max and z_max in world metres, the bounds of the robot's centre; null for none.
        start: x and z in world metres of a point in the connected part of the floor to use; null for the largest.

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
        """Whether the folder contains .glb files."""
        return any(folder.glob("*.glb"))

    def names(self, folder: Path) -> dict[str, list[str]]:
        """The splits of the split file, or random splits."""
        if self._split_file is not None:
            return read_split_file(Path(os.path.abspath(Path(self._split_file).expanduser())))
        pool = sorted((path.stem for path in folder.glob("*.glb")), key=self._place)
        count = max(1, round(HELD_OUT * len(pool)))
        return {"train": pool[2 * count :], "validation": pool[count : 2 * count], "test": pool[:count]}

    def splits(self) -> SceneSplits:
        """The requested buildings; warns if the splits are random."""
        if self._split_file is None:
            names = self.names(folder := self.folder)
            log.warning(
                "Gibson: the buildings in %s are split at random by scenes.split_seed=%d, because scenes.split_file is "
                "not set: %d train, %d validation, %d test.",
                folder,
                self._split_seed,
                *(len(names[split]) for split in SPLIT_COLUMNS),
            )
        return super().splits()

    def files(self, folder: Path, name: str) -> ScanFiles:
        """The building's mesh, and its navigation mesh."""
        return ScanFiles(folder / f"{name}.glb", (), (folder / f"{name}.navmesh",))

    def _place(self, name: str) -> str:
        # A hash instead of a shuffle: adding a building does not change the order of the others.
        return hashlib.sha256(f"{self._split_seed}:{name}".encode()).hexdigest()


def read_split_file(path: Path) -> dict[str, list[str]]:
    """Read a list of splits: a .csv table with a column `id` and columns `train`, `val` and `test` of 0 and 1.

    Raises:
        DeuxError: the file cannot be read or is not such a table.
    """
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            rows = list(csv.DictReader(file, skipinitialspace=True))
    except (OSError, UnicodeDecodeError) as error:
        raise DeuxError(f"scenes.split_file is {path}, which cannot be read: {error}.") from error
    columns = set(rows[0]) if rows else set()
    if "id" not in columns or not {"train", "test"} <= columns or not {"val", "validation"} & columns:
        raise DeuxError(f"scenes.split_file is {path}, which is not a table with the columns id, train, val and test.")
    return {
        split: [row["id"].strip() for row in rows if any((row.get(c) or "").strip() == "1" for c in chosen)]
        for split, chosen in SPLIT_COLUMNS.items()
    }
