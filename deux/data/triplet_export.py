"""Datasets as the training scripts of the KBNet family read them, after their set-up.

    <folder>/
        data/<sequence>/
            image/                                   NNNNNN.png, three images side by side: source, target, source
            sparse_depth/ validity_map/ ground_truth/   NNNNNN.png, of the target
            absolute_pose/                           NNNNNN.txt, and NNNNNN-1.txt and NNNNNN-2.txt of the sources
            K.npy                                    K-NNNNNN.npy of each target, where a sequence has several cameras
        {train,test}_{image,sparse_depth,validity_map,ground_truth,intrinsics}.txt

The lines of the list files are absolute paths, which the scripts open wherever they are started. A target without
source frames stands three times in its image, as the published set-up has it in its test set.
"""

import io
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from deux.contracts import FrameReference, Triplet
from deux.data.exported_split import SOURCES, ExportedSplit, FrameFiles, complete_lists
from deux.io.atomic import make_folder, write_atomically
from deux.io.images import write_image
from deux.io.layout import SUFFIXES, list_file

LISTED = ("image", "sparse_depth", "validity_map", "ground_truth")
INTRINSICS = "K.npy"


def write_triplets(folder: Path, splits: Sequence[ExportedSplit], final: Path) -> Iterator[None]:
    """Write all targets; goes on whenever one is written.

    Args:
        folder: takes the dataset.
        splits: to export; the names of their sequences are disjoint.
        final: where the folder will lie once it is whole: what the list files say.
    """
    for split in splits:
        lines: dict[str, list[str]] = {kind: [] for kind in (*LISTED, "intrinsics")}
        for sequence, triplets in split.sequences().items():
            files = FrameFiles(folder / "data" / sequence, split.reader)
            for triplet in triplets:
                _write_triplet(files, triplet)
                yield
            cameras = _write_intrinsics(files, [triplet.target for triplet in triplets])
            lines["intrinsics"] += [f"data/{sequence}/{name}" for name in cameras]
            for kind in LISTED:
                names = [f"{triplet.target.name}{SUFFIXES[kind]}" for triplet in triplets]
                lines[kind] += [f"data/{sequence}/{kind}/{n}" for n in names if (files.folder / kind / n).is_file()]
        for kind, named in complete_lists(split, lines).items():
            content = "".join(f"{final}/{line}\n" for line in named)
            write_atomically(list_file(folder, split.name, kind), content.encode())


def source_name(target: str, number: int) -> str:
    """The name of a target's first (1) or second (2) source frame."""
    return f"{target}-{number}"


def own_intrinsics(target: str) -> str:
    """The file of a target's intrinsics in a sequence that has several cameras."""
    return f"K-{target}.npy"


def _write_triplet(files: FrameFiles, triplet: Triplet) -> None:
    target, sources = triplet
    first, second = sources if len(sources) == SOURCES else (target, target)
    images = [files.reader.image(frame) for frame in (first, target, second)]
    make_folder(files.folder / "image")
    write_image(files.folder / "image" / f"{target.name}.png", np.concatenate(images, axis=1))
    files.write_sparse(files.reader.sparse_depth(target), target.name)
    files.write_ground_truth(target, target.name)
    files.write_pose(target, target.name)
    for number, source in enumerate((first, second), start=1):
        files.write_pose(source, source_name(target.name, number))


def _write_intrinsics(files: FrameFiles, targets: Sequence[FrameReference]) -> list[str]:
    """Write the cameras of a sequence's targets, one file where they are the same; the file's name for each target."""
    matrices = [files.reader.intrinsics(target) for target in targets]
    one = all(np.array_equal(matrix, matrices[0]) for matrix in matrices)
    names = [INTRINSICS if one else own_intrinsics(target.name) for target in targets]
    for name, matrix in dict(zip(names, matrices, strict=True)).items():
        content = io.BytesIO()
        np.save(content, matrix, allow_pickle=False)
        write_atomically(files.folder / name, content.getvalue())
    return names
