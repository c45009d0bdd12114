"""A dataset of two rooms as the splits of an export."""

import shutil
from pathlib import Path

import numpy as np
from void_layout import walk, write

from deux.contracts import FrameReference, Reader
from deux.data.dataset_reader import DatasetReader
from deux.data.exported_split import ExportedSplit, read_splits


def splits(folder: Path, frames: int = 15) -> list[ExportedSplit]:
    """A training and a test split, which share the name of a sequence."""
    readers: dict[str, Reader] = {}
    for split, scenes in (("train", ("hall", "kitchen")), ("test", ("hall",))):
        recordings = {f"{scene}-00": walk(scene, frames) for scene in scenes}
        readers[split] = DatasetReader(write(folder / split, recordings, split, triplets=True))
    return read_splits(readers, (-1, -2))


class Zooming(DatasetReader):
    """Another camera at each frame, as of a lens that focuses."""

    def intrinsics(self, frame: FrameReference) -> np.ndarray:
        matrix = super().intrinsics(frame)
        matrix[[0, 1], [0, 1]] += float(frame.name)
        return matrix


def zooming_split(folder: Path) -> ExportedSplit:
    """One sequence with as many cameras as frames."""
    readers: dict[str, Reader] = {"train": Zooming(write(folder, {"hall-00": walk("hall", 6)}, triplets=True))}
    return read_splits(readers, (-1, -2))[0]


def split_with_gaps(folder: Path) -> ExportedSplit:
    """Two sequences, the second without ground truth."""
    recordings = {scene: walk(scene, 6) for scene in ("hall-00", "kitchen-00")}
    written = write(folder, recordings, triplets=True)
    shutil.rmtree(written / "data" / "kitchen-00" / "ground_truth")
    return read_splits({"train": DatasetReader(written)}, (-1, -2))[0]
