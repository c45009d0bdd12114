"""The reader `data=webdataset`: tar shards of samples, with random access."""

import re
import tarfile
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from deux.contracts import FrameReference, MissingSplit, Reader, Triplet
from deux.errors import DeuxError, shown
from deux.io.calibration import checked_intrinsics, checked_pose
from deux.io.file_names import is_frame_path
from deux.io.images import decode_depth, decode_image
from deux.io.json_files import checked_object, decode_json


class _Member(NamedTuple):
    """The location of a file in a shard."""

    shard: Path
    offset: int
    size: int


@dataclass(frozen=True)
class Shards(Reader):
    """Reads shards `<split>-NNNNNN.tar`, as written by `task=export_dataset export_dataset.format=webdataset`.

    On first use all headers are read to build an index, so that frames can be read in any order. The package
    `webdataset` can stream the same shards (docs/export.md).

    Args:
        folder: the folder of the shards.
    """

    folder: Path

    def triplets(self, split: str, offsets: tuple[int, ...]) -> list[Triplet]:
        """The targets of a split, sorted by name, each with the source frames of its sample."""
        samples = self._index.get(split)
        if not samples:
            raise MissingSplit(
                f"{self.folder} has no {split} split: shards {split}-000000.tar and so on are expected; it has "
                f"{', '.join(sorted(self._index)) or 'no shards at all'}."
            )
        return [self._triplet(key, kinds) for key, kinds in sorted(samples.items())]

    def image(self, frame: FrameReference) -> np.ndarray:
        """H x W x 3 uint8."""
        key, kind = _key(frame)
        return decode_image(*self._read(key, f"{kind}.png"))

    def intrinsics(self, frame: FrameReference) -> np.ndarray:
        """3 x 3 float64."""
        key, kind = _key(frame)
        camera, path = self._camera(key)
        number, others = _number(kind), camera.get("source_intrinsics")
        if number == 0 or others is None:
            return checked_intrinsics(_numbers(camera.get("intrinsics"), "intrinsics", path), path)
        own = _item(others, number - 1, "source_intrinsics", path)
        return checked_intrinsics(_numbers(own, f"source_intrinsics[{number - 1}]", path), path)

    def sparse_depth(self, frame: FrameReference) -> np.ndarray:
        """H x W float32 metres, 0 = none; only for targets."""
        return decode_depth(*self._read(_key(frame)[0], "sparse_depth.png"))

    def ground_truth(self, frame: FrameReference) -> np.ndarray | None:
        """H x W float32 metres, 0 = none; None for a sample without ground truth."""
        key = _key(frame)[0]
        return decode_depth(*self._read(key, "ground_truth.png")) if "ground_truth.png" in self._find(key) else None

    def pose(self, frame: FrameReference) -> np.ndarray | None:
        """4 x 4 float64; None for a sample without poses."""
        key, kind = _key(frame)
        camera, path = self._camera(key)
        poses = camera.get("poses")
        number = _number(kind)
        if poses is None:
            return None
        return checked_pose(_numbers(_item(poses, number, "poses", path), f"poses[{number}]", path), path)

    def _camera(self, key: str) -> tuple[dict[str, Any], Path]:
        content, path = self._read(key, "camera.json")
        return checked_object(decode_json(content, path), path), path

    def _read(self, key: str, kind: str) -> tuple[bytes, Path]:
        """Read a file of a sample; also returns its path for messages."""
        members = self._find(key)
        if kind not in members:
            raise DeuxError(f"the sample {key} of {self.folder} has no {kind}: it has {', '.join(sorted(members))}.")
        member = members[kind]
        try:
            with member.shard.open("rb") as file:
                file.seek(member.offset)
                return file.read(member.size), member.shard / f"{key}.{kind}"
        except OSError as error:
            raise DeuxError(f"{member.shard} cannot be read: {error.strerror}.") from error

    def _find(self, key: str) -> dict[str, _Member]:
        for samples in self._index.values():
            if key in samples:
                return samples[key]
        raise DeuxError(f"{self.folder} has no sample {key}.")

    @cached_property
    def _index(self) -> dict[str, dict[str, dict[str, _Member]]]:
        """The files of each split, by the key of the sample and the kind of file."""
        index: dict[str, dict[str, dict[str, _Member]]] = {}
        for shard in sorted(self.folder.glob("*-*.tar")):
            samples = index.setdefault(shard.name.rpartition("-")[0], {})
            try:
                with tarfile.open(shard, "r:") as archive:
                    for member in (member for member in archive if member.isfile()):
                        folder, _, file = member.name.rpartition("/")
                        stem, _, kind = file.partition(".")
                        if not is_frame_path(folder, stem):  # results are written to paths with these names
                            raise DeuxError(
                                f"{shard} contains {shown(member.name)}: a relative path <sequence>/<frame>.<kind> "
                                "without .. is expected."
                            )
                        place = _Member(shard, member.offset_data, member.size)
                        samples.setdefault(f"{folder}/{stem}", {})[kind] = place
            except (tarfile.TarError, OSError) as error:
                raise DeuxError(f"{shard} is damaged or not a tar file: {error}.") from error
        return index

    def _triplet(self, key: str, kinds: dict[str, _Member]) -> Triplet:
        sequence, _, name = key.rpartition("/")
        sources = sorted(kind.removesuffix(".png") for kind in kinds if re.fullmatch(r"source\d+\.png", kind))
        return Triplet(
            FrameReference(sequence, name), tuple(FrameReference(sequence, f"{name}.{kind}") for kind in sources)
        )


def _numbers(value: Any, name: str, path: Path) -> np.ndarray:
    """Convert a value of the JSON file to a float64 array."""
    try:
        return np.array(value, np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise DeuxError(f"{path} is damaged: {name} is {shown(value)} where rows of numbers are expected.") from error


def _key(frame: FrameReference) -> tuple[str, str]:
    """The key of the frame's sample, and the kind of its image."""
    name, _, kind = frame.name.partition(".")
    return f"{frame.sequence}/{name}", kind or "image"


def _number(kind: str) -> int:
    """0 for the target's image, 1 and so on for its source frames."""
    return 0 if kind == "image" else int(kind.removeprefix("source"))


def _item(values: Any, number: int, name: str, path: Path) -> Any:
    """One item of a list in the JSON file."""
    if not isinstance(values, list) or number >= len(values):
        raise DeuxError(f"{path} is damaged: {name} is not a list with an item {number}.")
    return values[number]
