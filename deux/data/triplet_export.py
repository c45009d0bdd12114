"""Export of datasets in the format that the training scripts of the KBNet family read after their set-up.

    <folder>/
        data/<sequence>/
            image/                                   NNNNNN.png, three images side by side: source, target, source
            sparse_depth/ validity_map/ ground_truth/   NNNNNN.png, of the target
            absolute_pose/                           NNNNNN.txt, and NNNNNN-1.txt and NNNNNN-2.txt of the sources
            K.npy                                    where a sequence has several cameras, K-NNNNNN.npy of each target,
                                                     K-NNNNNN-1.npy and K-NNNNNN-2.npy of the sources
        {train,test}_{image,sparse_depth,validity_map,ground_truth,intrinsics}.txt

The list files contain absolute paths. The image of a target without source frames contains the target three times, as
in the test set of the published set-up.
"""

import io
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from deux.contracts import FrameReference, Triplet
from deux.data.checked_frames import intrinsics_of
from deux.data.exported_split import SOURCES, ExportedSplit, FrameExport, complete_lists, read_target
from deux.errors import DeuxError
from deux.io.atomic import write_atomically
from deux.io.layout import SUFFIXES, list_file

LISTED = ("image", "sparse_depth", "validity_map", "ground_truth")
INTRINSICS = "K.npy"


def write_triplets(folder: Path, splits: Sequence[ExportedSplit], final: Path) -> Iterator[None]:
    """Write all splits, as a generator that yields after each target.

    Args:
        folder: the folder of the dataset.
        splits: the splits; the names of their sequences are disjoint.
        final: the folder to which the finished dataset will be moved, for the list files.

    Raises:
        DeuxError: a frame's name clashes with the name that this format gives to a source frame.
    """
    for split in splits:
        lines: dict[str, list[str]] = {kind: [] for kind in (*LISTED, "intrinsics")}
        for sequence, triplets in split.sequences().items():
            _check_names(sequence, triplets)
            files = FrameExport(folder / "data" / sequence, split.reader)
            for triplet in triplets:
                _write_triplet(files, triplet)
                yield
            cameras = _write_intrinsics(files, triplets)
            lines["intrinsics"] += [f"data/{sequence}/{name}" for name in cameras]
            for kind in LISTED:
                names = [f"{triplet.target.name}{SUFFIXES[kind]}" for triplet in triplets]
                lines[kind] += [f"data/{sequence}/{kind}/{n}" for n in names if (files.folder / kind / n).is_file()]
        for kind, named in complete_lists(split, lines).items():
            content = "".join(f"{final}/{line}\n" for line in named)
            write_atomically(list_file(folder, split.name, kind), content.encode())


def source_name(target: str, number: int) -> str:
    """The exported name of a target's first (1) or second (2) source frame."""
    return f"{target}-{number}"


def own_intrinsics(frame: str) -> str:
    """The file name of a frame's intrinsics in a sequence with several cameras."""
    return f"K-{frame}.npy"


def _write_triplet(files: FrameExport, triplet: Triplet) -> None:
    target = triplet.target
    first, second = _source_frames(triplet)
    images, sparse_depth, truth = read_target(files.reader, Triplet(target, (first, second)))
    files.write_image(np.concatenate([images[1], images[0], images[2]], axis=1), target.name)
    files.write_sparse(sparse_depth, target.name)
    files.write_ground_truth(truth, target.name)
    files.write_pose(target, target.name)
    for number, source in enumerate((first, second), start=1):
        files.write_pose(source, source_name(target.name, number))


def _source_frames(triplet: Triplet) -> tuple[FrameReference, ...]:
    """The two frames beside the target in its image: the target itself if it does not have two source frames."""
    return triplet.sources if len(triplet.sources) == SOURCES else (triplet.target,) * SOURCES


def _check_names(sequence: str, triplets: Sequence[Triplet]) -> None:
    targets = {triplet.target.name for triplet in triplets}
    for name in sorted(targets):
        for number in range(1, SOURCES + 1):
            if source_name(name, number) in targets:
                raise DeuxError(
                    f'the sequence {sequence} has a frame "{source_name(name, number)}", the name that '
                    f'export_dataset.format=triplets gives to a source frame of "{name}": choose another format, or '
                    "rename the frame."
                )


def _write_intrinsics(files: FrameExport, triplets: Sequence[Triplet]) -> list[str]:
    """Write the intrinsics of a sequence, one file if all are equal; returns the file name for each target."""
    targets = [triplet.target.name for triplet in triplets]
    matrices: dict[str, np.ndarray] = {}
    for triplet in triplets:
        matrices[triplet.target.name] = intrinsics_of(files.reader, triplet.target)
        for number, source in enumerate(_source_frames(triplet), start=1):
            matrices[source_name(triplet.target.name, number)] = intrinsics_of(files.reader, source)
    one = matrices[targets[0]]
    if all(np.array_equal(matrix, one) for matrix in matrices.values()):
        _write_matrix(files.folder / INTRINSICS, one)
        return [INTRINSICS] * len(targets)
    for name, matrix in matrices.items():
        _write_matrix(files.folder / own_intrinsics(name), matrix)
    return [own_intrinsics(target) for target in targets]


def _write_matrix(path: Path, matrix: np.ndarray) -> None:
    content = io.BytesIO()
    np.save(content, matrix, allow_pickle=False)
    write_atomically(path, content.getvalue())
