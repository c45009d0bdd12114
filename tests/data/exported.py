"""A dataset of two rooms as the splits of an export."""

from pathlib import Path

from void_layout import walk, write

from deux.contracts import Reader
from deux.data.dataset_reader import DatasetReader
from deux.data.exported_split import ExportedSplit, read_splits


def splits(folder: Path, frames: int = 15) -> list[ExportedSplit]:
    """A training and a test split, which share the name of a sequence."""
    readers: dict[str, Reader] = {}
    for split, scenes in (("train", ("hall", "kitchen")), ("test", ("hall",))):
        recordings = {f"{scene}-00": walk(scene, frames) for scene in scenes}
        readers[split] = DatasetReader(write(folder / split, recordings, split, triplets=True))
    return read_splits(readers, (-1, -2))
