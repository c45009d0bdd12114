"""Export of datasets as tar shards in the WebDataset format, which a data loader streams in the order on disk.

    <folder>/<split>-NNNNNN.tar, a sample of which is
        <sequence>/<frame>.image.png
        <sequence>/<frame>.source1.png, .source2.png
        <sequence>/<frame>.sparse_depth.png, .ground_truth.png     16 bits, metres x 256, 0 = none
        <sequence>/<frame>.camera.json                             intrinsics; poses of the target and of its sources

Samples of the training split are shuffled, so that a stream needs no large shuffle buffer.
"""

import io
import json
import tarfile
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from deux.contracts import FrameReference, Reader, Triplet
from deux.data.checked_frames import intrinsics_of, pose_of
from deux.data.exported_split import ExportedSplit, read_target
from deux.errors import DeuxError
from deux.io.atomic import make_folder, write_failure
from deux.io.images import encode_depth, encode_image


def write_shards(folder: Path, splits: Sequence[ExportedSplit], samples: int = 1000) -> Iterator[None]:
    """Write the shards of all splits, as a generator that yields after each target.

    Args:
        folder: the folder of the shards.
        splits: the splits; the names of their sequences are disjoint.
        samples: number of samples in a shard.

    Raises:
        DeuxError: a frame cannot be read, its arrays differ in size, or a shard cannot be written.
    """
    make_folder(folder)
    for split in splits:
        order = np.arange(len(split.triplets))
        if split.name == "train":
            order = np.random.default_rng(0).permutation(order)
        for number, first in enumerate(range(0, len(order), samples)):
            path = folder / shard_name(split.name, number)
            try:
                with tarfile.open(path, "w", format=tarfile.USTAR_FORMAT) as shard:
                    for index in order[first : first + samples]:
                        triplet = split.triplets[index]
                        _add_sample(
                            shard, f"{split.sequence(triplet.target)}/{_key(triplet.target)}", split.reader, triplet
                        )
                        yield
            except OSError as error:  # a write error: readers raise DeuxError
                raise DeuxError(write_failure(path, error)) from error


def shard_name(split: str, number: int) -> str:
    """The file name of a split's shard."""
    return f"{split}-{number:06d}.tar"


def _key(frame: FrameReference) -> str:
    # WebDataset takes what follows the first dot of a file's name as the kind of file.
    return frame.name.replace(".", "_")


def _add_sample(shard: tarfile.TarFile, key: str, reader: Reader, triplet: Triplet) -> None:
    frames = (triplet.target, *triplet.sources)
    images, sparse_depth, truth = read_target(reader, triplet)
    for kind, image in zip(("image", *(f"source{n + 1}" for n in range(len(triplet.sources)))), images, strict=True):
        _add(shard, f"{key}.{kind}.png", encode_image(image))
    _add(shard, f"{key}.sparse_depth.png", encode_depth(sparse_depth))
    if truth is not None:
        _add(shard, f"{key}.ground_truth.png", encode_depth(truth))
    poses = [pose_of(reader, frame) for frame in frames]
    intrinsics, *others = [intrinsics_of(reader, frame).tolist() for frame in frames]
    camera = {
        "intrinsics": intrinsics,
        "poses": None if any(pose is None for pose in poses) else [pose.tolist() for pose in poses],  # type: ignore[union-attr]
    }
    if any(other != intrinsics for other in others):
        camera["source_intrinsics"] = others
    _add(shard, f"{key}.camera.json", json.dumps(camera).encode())


def _add(shard: tarfile.TarFile, name: str, content: bytes) -> None:
    member = tarfile.TarInfo(name)
    member.size = len(content)
    shard.addfile(member, io.BytesIO(content))
