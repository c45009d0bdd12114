"""Reading datasets in the VOID release's layout, ours or the release itself: list files first, pixels when asked."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from deux.data.atomic import read_bytes
from deux.data.layout import SequencePaths, list_file
from deux.data.verification import targets
from deux.errors import DeuxError


@dataclass(frozen=True)
class Triplet:
    """A target frame and its source frames.

    Args:
        paths: their sequence.
        target: name of frame t.
        sources: names of the source frames, t-1 and t-2 in our own datasets.
    """

    paths: SequencePaths
    target: str
    sources: tuple[str, ...]


def read_split(dataset: Path, split: str, offsets: tuple[int, ...] = (-1, -2)) -> list[Triplet]:
    """The triplets of a split, in the order of its list files.

    Our own datasets list them. Elsewhere, as in the VOID release, the split's image list names the targets, and the
    source frames are those at the offsets in the sequence; targets at its ends that lack one are left out.

    Args:
        dataset: the dataset's folder.
        split: "train", "validation" or "test".
        offsets: the source frames, in frames from the target, where the dataset has no triplet list; the published
            code takes (-10, 10) on VOID.

    Raises:
        DeuxError: the dataset has no such split or its list names nothing.
    """
    listed = list_file(dataset, split, "triplets")
    if listed.exists():
        found = [_listed_triplet(dataset, line) for line in _lines(listed)]
    elif list_file(dataset, split, "image").exists():
        found = _neighbours(dataset, _lines(list_file(dataset, split, "image")), offsets)
    else:
        there = sorted({path.name.rsplit("_image.txt")[0] for path in dataset.glob("*_image.txt")})
        raise DeuxError(
            f"{dataset} has no {split} split, whose frames {split}_image.txt would list; it has "
            f"{', '.join(there) or 'no list files at all'}."
        )
    if not found:
        raise DeuxError(f"The {split} split of {dataset} has no frames.")
    return found


class FileCache:
    """Keeps what was read from files, up to a bound; what does not fit is read anew each time.

    Frames are read in random order, so there is nothing to gain from dropping old ones for new.

    Args:
        capacity: bound in bytes.
    """

    def __init__(self, capacity: int) -> None:
        self._left = capacity
        self._arrays: dict[Path, np.ndarray] = {}

    def read(self, path: Path, reader: Callable[[Path], np.ndarray]) -> np.ndarray:
        """What `reader` reads from the file; the array is shared and must not be changed."""
        array = self._arrays.get(path)
        if array is None:
            array = reader(path)
            if array.nbytes <= self._left:
                self._left -= array.nbytes
                self._arrays[path] = array
        return array


def _lines(path: Path) -> list[str]:
    try:
        return read_bytes(path).decode().splitlines()
    except UnicodeDecodeError as error:
        raise DeuxError(f"{path} is no list of frames: it is not a text file.") from error


def _frame(dataset: Path, line: str) -> tuple[SequencePaths, str]:
    """Sequence and frame of an image's path; what comes before `data/` may differ from the dataset's folder now."""
    parts = Path(line).parts
    if len(parts) < 4 or parts[-4] != "data":
        raise DeuxError(f"{dataset} lists {line}, where a path like data/<sequence>/image/<frame>.png is expected.")
    return SequencePaths(dataset / "data" / parts[-3]), parts[-1].removesuffix(".png")


def _listed_triplet(dataset: Path, line: str) -> Triplet:
    frames = [_frame(dataset, image) for image in line.split("\t")]
    return Triplet(frames[0][0], frames[0][1], tuple(name for _, name in frames[1:]))


def _neighbours(dataset: Path, lines: list[str], offsets: tuple[int, ...]) -> list[Triplet]:
    sources: dict[SequencePaths, dict[str, tuple[str, ...]]] = {}
    found = []
    for line in lines:
        paths, name = _frame(dataset, line)
        if paths not in sources:
            sources[paths] = {triplet[0]: triplet[1:] for triplet in targets(paths.frames(), offsets)}
        if name in sources[paths]:
            found.append(Triplet(paths, name, sources[paths][name]))
    return found
