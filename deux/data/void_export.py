"""Export of datasets in the layout of the VOID release, for the set-up script and data loaders of the KBNet family.

    <folder>/
        void_150/ void_500/ void_1500/          the same frames with a tenth, a third and all of their sparse points
            data/<sequence>/
                image/ sparse_depth/ validity_map/ ground_truth/   NNNNNN.png
                absolute_pose/                                     NNNNNN.txt, if there are poses
                K.txt
            {train,test}_{image,sparse_depth,validity_map,ground_truth,absolute_pose,intrinsics}.txt

The published set-up script leaves out the first and the last 30 files of a training sequence, and uses the files ten
before and ten after each target as its source frames. Frames of a robot that far apart overlap little, so by default
the files are arranged such that these are the target's actual source frames: of thirty files, the first ten are the
first source frames of ten triplets, the next ten the targets and the last ten the second source frames. Frames that
occur several times are hard links. In a test sequence each file is a target.
"""

import os
import shutil
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Literal

import numpy as np

from deux.contracts import FrameReference, Reader, Triplet
from deux.data.checked_frames import image_of, intrinsics_of
from deux.data.exported_split import ExportedSplit, FrameExport, complete_lists, read_target
from deux.data.frame_sizes import Size, check_one_size
from deux.errors import DeuxError
from deux.io.atomic import make_folder, write_atomically
from deux.io.calibration import write_matrix
from deux.io.layout import PUBLISHED_KINDS, SUFFIXES, frame_name, list_file, natural_order

Arrangement = Literal["triplets", "time"]
"""The order of files in training sequences: source frames ten files from their target, or the order of time."""

DENSITIES = {"void_150": 0.1, "void_500": 1 / 3, "void_1500": 1.0}
"""The folders of the release, named after their number of points, and the fraction of our points in each."""

FULL = "void_1500"
SOURCE_DISTANCE = 10
"""Files between a target and either source frame, in the published set-up script."""

MARGIN = 30
"""Files at either end of a training sequence that the published set-up script leaves out."""


def write_void(folder: Path, splits: Sequence[ExportedSplit], arrangement: Arrangement = "triplets") -> Iterator[None]:
    """Write the folders of all three densities, as a generator that yields after each target.

    Args:
        folder: the folder of `void_150`, `void_500` and `void_1500`.
        splits: the splits; the names of their sequences are disjoint.
        arrangement: the order of files in training and validation sequences.

    Raises:
        DeuxError: a sequence has several cameras, which the layout does not support, or images of several sizes.
    """
    for split in splits:
        _check_cameras(split)
    for split in splits:
        lists: dict[str, list[str]] = {kind: [] for kind in (*PUBLISHED_KINDS, "intrinsics")}
        for sequence, triplets in split.sequences().items():
            arranged = arrange(triplets, arrangement) if split.name != "test" else [t.target for t in triplets]
            targets = _target_places(arranged, triplets, split.name, arrangement)
            yield from _write_sequence(folder, sequence, split.reader, arranged, targets)
            for kind, lines in lists.items():
                lines += _lines(folder / FULL, sequence, kind, targets)
        for kind, lines in complete_lists(split, lists).items():
            for density in DENSITIES:
                content = "".join(f"{density}/{line}\n" for line in lines)
                write_atomically(list_file(folder / density, split.name, kind), content.encode())


def arrange(triplets: Sequence[Triplet], arrangement: Arrangement) -> list[FrameReference]:
    """The frames of a training sequence in the order of their files."""
    if arrangement == "time":
        frames = {frame for target, sources in triplets for frame in (target, *sources)}
        return sorted(frames, key=lambda frame: natural_order(frame.name))
    # The script leaves out the files before the first and after the last target.
    before = MARGIN - SOURCE_DISTANCE
    arranged = [triplets[0].target] * before
    for first in range(0, len(triplets), SOURCE_DISTANCE):
        ten = list(triplets[first : first + SOURCE_DISTANCE])
        ten += [ten[-1]] * (SOURCE_DISTANCE - len(ten))
        arranged += [triplet.sources[0] for triplet in ten]
        arranged += [triplet.target for triplet in ten]
        arranged += [triplet.sources[1] for triplet in ten]
    return arranged + [triplets[-1].target] * MARGIN


def used_by_setup(splits: Sequence[ExportedSplit], arrangement: Arrangement) -> tuple[int, int]:
    """Number of training targets that the published set-up script uses, and number of all training targets."""
    used = total = 0
    for split in splits:
        for triplets in split.sequences().values() if split.name == "train" else ():
            arranged = arrange(triplets, arrangement)
            places = _target_places(arranged, triplets, split.name, arrangement)
            used += sum(MARGIN <= place < len(arranged) - SOURCE_DISTANCE - MARGIN for place in places)
            total += len(places)
    return used, total


def _target_places(
    arranged: Sequence[FrameReference], triplets: Sequence[Triplet], split: str, arrangement: Arrangement
) -> list[int]:
    """The index in `arranged` of each target in the list files."""
    if split == "test":
        return list(range(len(triplets)))
    if arrangement == "time":
        place = {frame: number for number, frame in enumerate(arranged)}
        return [place[triplet.target] for triplet in triplets]
    block, number = np.divmod(np.arange(len(triplets)), SOURCE_DISTANCE)
    return (MARGIN + 3 * SOURCE_DISTANCE * block + number).tolist()


def _write_sequence(
    folder: Path, sequence: str, reader: Reader, arranged: Sequence[FrameReference], targets: Sequence[int]
) -> Iterator[None]:
    """Write the files of one sequence, as a generator that yields after each target."""
    files = {density: FrameExport(folder / density / "data" / sequence, reader) for density in DENSITIES}
    first: dict[FrameReference, str] = {}
    listed = set(targets)
    size = f"frame {arranged[0].name}", image_of(reader, arranged[0]).shape[:2]
    for place, frame in enumerate(arranged):
        name = frame_name(place)
        known = first.setdefault(frame, name)
        if known == name:
            _write_frame(files, frame, name, size)
        else:
            for written in files.values():
                _link_all(written.folder, known, name)
        if place in listed:
            yield
    for written in files.values():
        write_matrix(written.folder / "K.txt", intrinsics_of(reader, arranged[0]))


def _write_frame(files: dict[str, FrameExport], frame: FrameReference, name: str, first: tuple[str, Size]) -> None:
    """Write the files of a frame; all densities share the files except those of the sparse points.

    Raises:
        DeuxError: the image has another size than the sequence's first image.
    """
    full = files[FULL]
    (image,), sparse, truth = read_target(full.reader, Triplet(frame, ()))
    check_one_size(full.reader, frame, image.shape[:2], [first])
    full.write_image(image, name)
    full.write_ground_truth(truth, name)
    full.write_pose(frame, name)
    for written in files.values():
        if written is not full:
            for kind in PUBLISHED_KINDS:
                _link(full.folder / kind, written.folder / kind, name, name, SUFFIXES[kind])
    # The points of lower densities are a subset of those of higher densities, as if fewer points were tracked.
    order = np.random.default_rng(0).permutation(np.flatnonzero(sparse))
    for density, written in files.items():
        thinned = np.zeros_like(sparse)
        chosen = order[: max(1, round(DENSITIES[density] * len(order)))]
        thinned.flat[chosen] = sparse.flat[chosen]
        written.write_sparse(thinned, name)


def _link_all(folder: Path, known: str, name: str) -> None:
    for kind in PUBLISHED_KINDS:
        _link(folder / kind, folder / kind, known, name, SUFFIXES[kind])


def _link(source: Path, target: Path, known: str, name: str, suffix: str) -> None:
    """Make a hard link to a file if it exists; a copy if the file system does not support hard links."""
    file, other = source / f"{known}{suffix}", target / f"{name}{suffix}"
    if not file.is_file():
        return
    make_folder(target)
    try:
        os.link(file, other)
    except OSError:
        shutil.copyfile(file, other)


def _lines(density: Path, sequence: str, kind: str, places: Sequence[int]) -> list[str]:
    """The lines of a list file relative to the density's folder, for targets that have a file of this kind."""
    if kind == "intrinsics":
        return [f"data/{sequence}/K.txt"] * len(places)
    lines = [f"data/{sequence}/{kind}/{frame_name(place)}{SUFFIXES[kind]}" for place in places]
    return [line for line in lines if (density / line).is_file()]


def _check_cameras(split: ExportedSplit) -> None:
    """Raise DeuxError if the frames of one sequence have different intrinsics: the layout has one K.txt for each."""
    for sequence, triplets in split.sequences().items():
        first = intrinsics_of(split.reader, triplets[0].target)
        for target, sources in triplets:
            for frame in (target, *sources):
                if not np.array_equal(intrinsics_of(split.reader, frame), first):
                    raise DeuxError(
                        f"export_dataset.format=void supports one camera for each sequence, but in {sequence} of "
                        f"{split.reader.folder} the camera of {frame.name} differs from that of "
                        f"{triplets[0].target.name}: use export_dataset.format=triplets or webdataset."
                    )
