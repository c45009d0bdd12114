"""Stage 4: the list files that a training set is read from."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from deux.collection.verification import Rejection
from deux.io.atomic import write_atomically
from deux.io.layout import PUBLISHED_KINDS, SUFFIXES, SequencePaths, list_file, neighbours


def write_lists(
    dataset: Path,
    name: str,
    split: str,
    found: Sequence[SequencePaths],
    verdicts: Mapping[str, Mapping[str, Rejection | None]],
    offsets: tuple[int, ...] = (-1, -2),
) -> int:
    """Write a split's six list files as the VOID release has them and the triplet list, all in the same order.

    A line of a list file names one target frame's file, from the dataset's own folder name on. A line of the triplet
    list names the images of a target and of its source frames, separated by tabs.

    Args:
        dataset: the dataset's folder, as it is now.
        name: the name of that folder once it is complete.
        split: "train", "validation" or "test".
        found: the sequences.
        verdicts: for each sequence's name, for each target frame, why it is rejected or None.
        offsets: the source frames, in frames from the target.

    Returns:
        The number of triplets.
    """
    lines: dict[str, list[str]] = {kind: [] for kind in (*PUBLISHED_KINDS, "intrinsics", "triplets")}
    for paths in found:
        folder = f"{name}/data/{paths.name}"
        for triplet in neighbours(paths.frames(), offsets):
            if verdicts[paths.name][triplet[0]] is not None:
                continue
            for kind in PUBLISHED_KINDS:
                lines[kind].append(f"{folder}/{kind}/{triplet[0]}{SUFFIXES[kind]}")
            lines["intrinsics"].append(f"{folder}/K.txt")
            lines["triplets"].append("\t".join(f"{folder}/image/{frame}{SUFFIXES['image']}" for frame in triplet))
    for kind, content in lines.items():
        write_atomically(list_file(dataset, split, kind), "".join(f"{line}\n" for line in content).encode())
    return len(lines["triplets"])
