"""The torch dataset of triplets and how its samples become batches."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path

import numpy as np
import torch
from torch import Tensor
from torch.utils.data import Dataset, Sampler

from deux.contracts import Augmentation, Batch, FrameReference, Reader, Triplet
from deux.data.augmentation import Sample, augment, crop
from deux.errors import DeuxError
from deux.geometry.poses import source_from_target

Prepare = Callable[[np.ndarray], dict[str, np.ndarray]]
"""A model's `prepare`: its further inputs, from H x W sparse depth."""


@dataclass(frozen=True)
class SampleSettings:
    """How frames become samples.

    Args:
        crop: height and width that are cut out; None takes the whole frame.
        training: whether the crop lies at random and the augmentation is drawn; otherwise the crop is in the middle.
        ground_truth: whether ground truth is read; without it its files are not touched.
        augmentation: the model's augmentation.
        prepare: the model's further inputs, from the points that the network is shown.
    """

    crop: tuple[int, int] | None = None
    training: bool = False
    ground_truth: bool = False
    augmentation: Augmentation = field(default_factory=Augmentation)
    prepare: Prepare | None = None


class FrameCache:
    """Keeps what was read of frames, up to a bound; what does not fit is read anew each time.

    Frames are read in random order, so there is nothing to gain from dropping old ones for new.

    Args:
        capacity: bound in bytes.
    """

    def __init__(self, capacity: int) -> None:
        self._left = capacity
        self._arrays: dict[tuple[Path, str, FrameReference], np.ndarray | None] = {}

    def read(self, reader: Reader, kind: str, frame: FrameReference) -> np.ndarray | None:
        """What the reader's method of that name reads; the array is shared and must not be changed."""
        key = reader.folder, kind, frame
        if key in self._arrays:
            return self._arrays[key]
        array: np.ndarray | None = getattr(reader, kind)(frame)
        size = 0 if array is None else array.nbytes
        if size <= self._left:
            self._left -= size
            self._arrays[key] = array
        return array


class TripletDataset(Dataset[Batch]):
    """The triplets of a split of one or several datasets; each item is a `Batch` without the first dimension.

    Items are asked for as (index, seed), the seed of whatever is random in the item, which `ShuffledDraws` provides; a
    bare index stands for seed 0.

    Args:
        readers: of the datasets.
        split: "train", "validation" or "test".
        settings: how frames become samples.
        cache: keeps decoded files; by default everything is read anew.
        offsets: the source frames, where a dataset does not list them.

    Raises:
        DeuxError: a dataset has no such split. Items raise it, naming the file, where one cannot be read.
    """

    def __init__(
        self,
        readers: Sequence[Reader],
        split: str,
        settings: SampleSettings,
        cache: FrameCache | None = None,
        offsets: tuple[int, ...] = (-1, -2),
    ) -> None:
        self.settings = settings
        self.triplets = [(reader, triplet) for reader in readers for triplet in reader.triplets(split, offsets)]
        self._cache = cache or FrameCache(0)

    def __len__(self) -> int:
        return len(self.triplets)

    def __getitem__(self, item: int | tuple[int, int]) -> Batch:
        index, seed = item if isinstance(item, tuple) else (item, 0)
        settings, (reader, triplet) = self.settings, self.triplets[index]
        sample = self._read(reader, triplet)
        rng = np.random.default_rng(seed)
        if settings.crop is not None:
            sample = _crop(sample, settings.crop, rng if settings.training else None, reader, triplet)
        if settings.training:
            sample = augment(sample, settings.augmentation, rng)
        return _tensors(sample, settings.prepare)

    def _read(self, reader: Reader, triplet: Triplet) -> Sample:
        """Read a triplet's frames; the sizes of its images and maps must agree."""
        frames = (triplet.target, *triplet.sources)
        images = [self._array(reader, "image", frame) for frame in frames]
        sparse_depth = self._array(reader, "sparse_depth", triplet.target)
        truth = self._cache.read(reader, "ground_truth", triplet.target) if self.settings.ground_truth else None
        for array in (*images[1:], sparse_depth, *([] if truth is None else [truth])):
            if array.shape[:2] != images[0].shape[:2]:
                raise DeuxError(
                    f"Of frame {triplet.target.name} of {triplet.target.sequence} in {reader.folder} something has "
                    f"{array.shape[0]} x {array.shape[1]} pixels where its image has {images[0].shape[0]} x "
                    f"{images[0].shape[1]}."
                )
        poses = [self._cache.read(reader, "pose", frame) for frame in frames]
        motions = None
        if all(pose is not None for pose in poses):
            motions = np.stack([source_from_target(poses[0], pose) for pose in poses[1:]])  # type: ignore[arg-type]
        return Sample(
            images=np.stack(images),
            sparse_depth=sparse_depth,
            input_sparse_depth=sparse_depth,
            intrinsics=self._array(reader, "intrinsics", triplet.target),
            source_from_target=motions,
            ground_truth=truth,
        )

    def _array(self, reader: Reader, kind: str, frame: FrameReference) -> np.ndarray:
        array = self._cache.read(reader, kind, frame)
        assert array is not None
        return array


class ShuffledDraws(Sampler[tuple[int, int]]):
    """Every index once an epoch in random order, each with the seed of its own augmentation.

    Order and seeds depend on the seed and the epoch alone, so they are the same for any number of workers. Processes
    that train together share the items out; all get equally many, so a few are left out where they do not go round.

    Args:
        size: number of items.
        seed: seed of all epochs.
        epoch: number of the first epoch; Lightning sets those that follow.
        share: which of the shares is drawn, from 0.
        shares: number of shares.
    """

    def __init__(self, size: int, seed: int, epoch: int = 0, share: int = 0, shares: int = 1) -> None:
        self._size, self._seed, self._epoch = size, seed, epoch
        self._share, self._shares = share, shares
        self._skipped: dict[int, int] = {}

    def __len__(self) -> int:
        return self._size // self._shares

    def __iter__(self) -> Iterator[tuple[int, int]]:
        rng = np.random.default_rng([self._seed, self._epoch])
        order, seeds = rng.permutation(self._size), rng.integers(2**62, size=self._size)
        mine = slice(self._share, len(self) * self._shares, self._shares)
        return islice(zip(order[mine].tolist(), seeds[mine].tolist(), strict=True), self.skipped, None)

    def set_epoch(self, epoch: int) -> None:
        """Draw the given epoch's order and seeds from the next iteration on."""
        self._epoch = epoch

    @property
    def epoch(self) -> int:
        """The epoch that is drawn."""
        return self._epoch

    @property
    def skipped(self) -> int:
        """Number of items that are left out at the beginning of this epoch."""
        return self._skipped.get(self._epoch, 0)

    def skip(self, epoch: int, items: int) -> None:
        """Leave out the first items of one epoch, which a training has seen before it was killed."""
        self._skipped = {epoch: items}


class LoadedBatch(Batch):
    """A batch that the loader can place in page-locked memory, from where it is copied to a GPU faster."""

    def pin_memory(self) -> "LoadedBatch":
        """Pin every tensor in place."""
        for name, value in vars(self).items():
            if isinstance(value, Tensor):
                setattr(self, name, value.pin_memory())
        self.prepared = {name: value.pin_memory() for name, value in self.prepared.items()}
        return self


def collate(samples: Sequence[Batch]) -> LoadedBatch:
    """Stack samples to a batch.

    Raises:
        DeuxError: the samples differ in size.
    """
    sizes = {tuple(sample.image.shape[-2:]) for sample in samples}
    if len(sizes) > 1:
        raise DeuxError(f"Frames of the sizes {sorted(sizes)} (height, width) do not fit in one batch: give a crop.")

    def stack(name: str) -> Tensor:
        return _stack([getattr(sample, name) for sample in samples])

    return LoadedBatch(
        image=stack("image"),
        sources=stack("sources"),
        sparse_depth=stack("sparse_depth"),
        validity=stack("validity"),
        input_sparse_depth=stack("input_sparse_depth"),
        intrinsics=stack("intrinsics"),
        source_from_target=None if samples[0].source_from_target is None else stack("source_from_target"),
        ground_truth=None if samples[0].ground_truth is None else stack("ground_truth"),
        prepared={name: _stack([sample.prepared[name] for sample in samples]) for name in samples[0].prepared},
    )


def _crop(
    sample: Sample, size: tuple[int, int], rng: np.random.Generator | None, reader: Reader, triplet: Triplet
) -> Sample:
    """Cut a window out, at random or from the middle."""
    room = sample.images.shape[1] - size[0], sample.images.shape[2] - size[1]
    if min(room) < 0:
        raise DeuxError(
            f"A crop of {size[0]} x {size[1]} does not fit in the {sample.images.shape[1]} x {sample.images.shape[2]} "
            f"pixels of frame {triplet.target.name} of {triplet.target.sequence} in {reader.folder}."
        )
    top, left = (room[0] // 2, room[1] // 2) if rng is None else (rng.integers(room[0] + 1), rng.integers(room[1] + 1))
    return crop(sample, int(top), int(left), *size)


def _tensors(sample: Sample, prepare: Prepare | None) -> Batch:
    # Numpy rather than torch: on a busy machine torch's threads wait for each other over arrays as small as these.
    images = np.ascontiguousarray(sample.images.transpose(0, 3, 1, 2)) / np.float32(255.0)
    sparse, shown = _map(sample.sparse_depth), _map(sample.input_sparse_depth)
    motions = sample.source_from_target
    prepared = prepare(np.ascontiguousarray(sample.input_sparse_depth)) if prepare is not None else {}
    return Batch(
        image=torch.from_numpy(images[0]),
        sources=torch.from_numpy(images[1:]),
        sparse_depth=torch.from_numpy(sparse),
        validity=torch.from_numpy((sparse > 0).astype(np.float32)),
        input_sparse_depth=torch.from_numpy(shown),
        intrinsics=torch.from_numpy(sample.intrinsics.astype(np.float32)),
        source_from_target=motions if motions is None else torch.from_numpy(motions.astype(np.float32)),
        ground_truth=None if sample.ground_truth is None else torch.from_numpy(_map(sample.ground_truth)),
        prepared={name: torch.from_numpy(value) for name, value in prepared.items()},
    )


def _map(depth: np.ndarray) -> np.ndarray:
    """1 x H x W of its own memory."""
    return np.array(depth[None], order="C")


def _stack(tensors: Sequence[Tensor]) -> Tensor:
    return torch.from_numpy(np.stack([tensor.numpy() for tensor in tensors]))
