"""The torch dataset of triplets, and the collation of its samples to batches."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy as np
import torch
from torch import Tensor
from torch.utils.data import Dataset

from deux.contracts import Augmentation, Batch, FrameReference, Reader, Triplet
from deux.data.augmentation import fix_batch_size
from deux.data.checked_frames import intrinsics_of, pose_of
from deux.data.chosen_sources import list_triplets, warn_of_cameras
from deux.data.device_batches import LoadedBatch, StoredSample, check_alike, device_batch
from deux.data.device_cache import DeviceCache
from deux.data.drawn_windows import Window
from deux.data.frame_cache import FrameCache, FrameKey, metres
from deux.data.frame_sizes import check_one_size
from deux.data.transforms import augment
from deux.errors import DeuxError, counted, image_size
from deux.geometry.poses import absorb_intrinsics, source_from_target
from deux.inference.prediction import prepare_sample
from deux.io.layout import SourceChoice

SourceFrames = Literal["needed", "unread"]
"""Whether samples contain source frames; if they are needed, targets without source frames are left out."""

Prepare = Callable[[np.ndarray], dict[str, np.ndarray]]
"""The type of `DepthModel.prepare`: computes a model's further inputs from H x W sparse depth."""


@dataclass(frozen=True)
class SampleSettings:
    """How samples are made from frames.

    Args:
        crop: height and width of the crop; None for no crop.
        training: whether to use random crops and the augmentation; otherwise centre crops without augmentation.
        ground_truth: whether ground truth is read.
        sources: whether source frames are read.
        poses: whether the poses of the source frames relative to the target are read.
        augmentation: the transforms, in order.
        prepare: computes the model's further inputs from the input sparse depth.
    """

    crop: tuple[int, int] | None = None
    training: bool = False
    ground_truth: bool = False
    sources: SourceFrames = "needed"
    poses: bool = True
    augmentation: Sequence[Augmentation] = ()
    prepare: Prepare | None = None


class Frames(NamedTuple):
    """The whole arrays from which a sample is cropped, in the types of the cache; they must not be modified.

    Args:
        images: 3 x H x W uint8 each, the target first.
        maps: H x W each, "sparse_depth" and, if it is read, "ground_truth".
    """

    images: list[Any]
    maps: dict[str, Any]


class TripletDataset(Dataset[Batch]):
    """The triplets of a split of one or several datasets; each item is a `Batch` without the batch dimension.

    An item is requested by (index, seed), where the seed determines its crop and augmentation
    (`deux.data.shuffled_draws`), or by the index alone for the seed 0. With a `DeviceCache`, a data loader's request
    for several items returns one batch on the cache's device.

    Args:
        readers: the readers of the datasets. Equal readers share cached arrays.
        split: "train", "validation" or "test".
        settings: how samples are made from frames.
        cache: the cache of images and depth maps; by default nothing is cached.
        offsets: the recent source frames, as offsets from the target; unused if a dataset lists them.
        choice: how source frames are chosen.

    Raises:
        DeuxError: a dataset has no such split, or source frames are needed and no target has any. Requesting an item
            raises it if a file cannot be read, or if ground truth is needed and does not exist.
    """

    def __init__(
        self,
        readers: Sequence[Reader],
        split: str,
        settings: SampleSettings,
        cache: FrameCache | None = None,
        offsets: tuple[int, ...] = (-1, -2),
        choice: SourceChoice = "recent",
    ) -> None:
        self.settings = settings
        choice = choice if settings.sources == "needed" else "recent"  # no need to choose frames that are not read
        listed = [(reader, triplet) for reader in readers for triplet in list_triplets(reader, split, choice, offsets)]
        self.triplets = [(reader, one) for reader, one in listed if one.sources or settings.sources != "needed"]
        if listed and not self.triplets:
            reason = "fewer than two frames around each have poses (training.sources=baseline)."
            if choice == "recent":
                places = " and ".join(f"{offset:+d}" for offset in offsets)
                reason = f"the frames at the offsets {places} (training.offsets) do not exist."
            raise DeuxError(
                f"None of the {counted(len(listed), f'{split} frame')} of {listed[0][0].folder} has source frames: "
                f"{reason}"
            )
        if settings.sources == "needed" and not settings.poses:
            for reader in readers:
                warn_of_cameras(reader, [triplet for other, triplet in self.triplets if other is reader])
        self.cache = cache or FrameCache()
        self._intrinsics: dict[tuple[Reader, FrameReference], np.ndarray] = {}
        self._motions: dict[tuple[Reader, Triplet], np.ndarray | None] = {}

    def __len__(self) -> int:
        return len(self.triplets)

    def __getitem__(self, item: int | tuple[int, int]) -> Batch:
        return self._item(item, self._augmentation(_index_and_seed(item)[1]))

    def __getitems__(self, items: Sequence[int | tuple[int, int]]) -> list[Batch] | Batch:
        """A list of items; with a `DeviceCache`, one batch on its device."""
        augmentation = self._augmentation(_index_and_seed(items[0])[1])
        if not isinstance(self.cache, DeviceCache):
            return [self._item(item, augmentation) for item in items]
        drawn = [(*self._triplet(index), seed) for index, seed in map(_index_and_seed, items)]
        keys = [list(self._keys(reader, triplet)) for reader, triplet, _ in drawn]
        stored = iter(self.cache.load([key for one in keys for key in one]))
        samples = []
        for (reader, triplet, seed), its in zip(drawn, keys, strict=True):
            frames = _frames(reader, triplet, [(key, next(stored)) for key in its])
            window = self._window(frames.images[0].shape[-2:], reader, triplet, seed, self.settings.poses)
            samples.append(StoredSample(*frames, window, seed))
        return device_batch(samples, augmentation, self.cache.device)

    def with_sources(self, index: int) -> Batch:
        """An item with its source frames and poses, even if samples do not contain them."""
        return _batch(self._host_sample(*self.triplets[index], seed=0, poses=True), self.settings.prepare)

    @property
    def keys(self) -> list[FrameKey]:
        """All arrays that the items are made of, without duplicates, in the order of the triplets."""
        keys = (key for index in range(len(self)) for key in self._keys(*self._triplet(index)))
        return list(dict.fromkeys(keys))

    def _item(self, item: int | tuple[int, int], augmentation: Sequence[Augmentation]) -> Batch:
        """Make one item on the CPU."""
        index, seed = _index_and_seed(item)
        sample = self._host_sample(*self._triplet(index), seed, self.settings.poses)
        return _batch(augment(sample, augmentation, seed) if augmentation else sample, self.settings.prepare)

    def _augmentation(self, seed: int) -> Sequence[Augmentation]:
        """The augmentation of a batch whose first item has this seed."""
        return fix_batch_size(self.settings.augmentation, seed) if self.settings.training else ()

    def _triplet(self, index: int) -> tuple[Reader, Triplet]:
        """A triplet, without its source frames if samples do not contain them."""
        reader, triplet = self.triplets[index]
        return reader, triplet if self.settings.sources == "needed" else Triplet(triplet.target, ())

    def _keys(self, reader: Reader, triplet: Triplet) -> Iterator[FrameKey]:
        """The arrays of a triplet: images (the target's first), sparse depth and ground truth."""
        for frame in (triplet.target, *triplet.sources):
            yield FrameKey(reader, "image", frame)
        yield FrameKey(reader, "sparse_depth", triplet.target)
        if self.settings.ground_truth:
            yield FrameKey(reader, "ground_truth", triplet.target)

    def _host_sample(self, reader: Reader, triplet: Triplet, seed: int, poses: bool) -> dict[str, np.ndarray]:
        """A cropped sample before augmentation, as new arrays; see `deux.data.sample_parts`."""
        keys = self._keys(reader, triplet)
        images, maps = _frames(reader, triplet, [(key, _array(self.cache.read(key))) for key in keys])
        window = self._window(images[0].shape[-2:], reader, triplet, seed, poses)
        part = slice(window.rows[0], window.rows[-1] + 1), slice(window.columns[0], window.columns[-1] + 1)
        sample = {"images": np.stack([image[:, *part] for image in images])}
        sample |= {name: metres(depth[part]) for name, depth in maps.items()}
        sample["intrinsics"] = window.intrinsics
        if window.motions is not None:
            sample["source_from_target"] = window.motions.copy()
        return sample

    def _camera(self, reader: Reader, frame: FrameReference) -> np.ndarray:
        """The camera matrix of the whole frame, 3 x 3; it must not be modified."""
        key = reader, frame
        if key not in self._intrinsics:
            self._intrinsics[key] = intrinsics_of(reader, frame)
        return self._intrinsics[key]

    def _relative_poses(self, reader: Reader, triplet: Triplet) -> np.ndarray | None:
        """`Batch.source_from_target`, S x 4 x 4, which must not be modified; None if a frame has no pose."""
        key = reader, triplet
        if key not in self._motions:
            motions = _motions(reader, triplet)
            if motions is not None:
                target, *sources = (self._camera(reader, frame) for frame in (triplet.target, *triplet.sources))
                pairs = zip(motions, sources, strict=True)
                motions = np.stack([absorb_intrinsics(motion, target, source) for motion, source in pairs])
            self._motions[key] = motions
        return self._motions[key]

    def _window(self, size: tuple[int, int], reader: Reader, triplet: Triplet, seed: int, poses: bool) -> Window:
        """The crop of a triplet's frames, and its camera."""
        height, width = self.settings.crop or size
        room = size[0] - height, size[1] - width
        if min(room) < 0:
            raise DeuxError(
                f"Frame {triplet.target.name} of {triplet.target.sequence} in {reader.folder} has {image_size(size)} "
                f"pixels (width x height), too few for a crop of {image_size((height, width))}: reduce training.crop."
            )
        if self.settings.training and self.settings.crop is not None:
            rng = np.random.default_rng(seed)
            top, left = int(rng.integers(room[0] + 1)), int(rng.integers(room[1] + 1))
        else:
            top, left = room[0] // 2, room[1] // 2
        intrinsics = self._camera(reader, triplet.target).copy()
        intrinsics[:2, 2] -= left, top
        motions = self._relative_poses(reader, triplet) if poses else None
        return Window(np.arange(top, top + height), np.arange(left, left + width), intrinsics, motions)


def collate(samples: Sequence[Batch] | Batch) -> Batch:
    """Stack samples to a batch; a batch is returned as it is.

    Raises:
        DeuxError: the samples differ in size or number of source frames, or only some have poses.
    """
    if isinstance(samples, Batch):
        return samples
    check_alike(
        (tuple(sample.image.shape[-2:]), len(sample.sources), sample.source_from_target is not None)
        for sample in samples
    )

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


def _motions(reader: Reader, triplet: Triplet) -> np.ndarray | None:
    """S x 4 x 4, transforms points of the target camera to each source camera; None if a frame has no pose."""
    if not triplet.sources:
        return None
    poses = [pose_of(reader, frame) for frame in (triplet.target, *triplet.sources)]
    if any(pose is None for pose in poses):
        return None
    return source_from_target(poses[0], np.stack(poses[1:]))  # type: ignore[arg-type]


def _index_and_seed(item: int | tuple[int, int]) -> tuple[int, int]:
    return item if isinstance(item, tuple) else (item, 0)


def _frames(reader: Reader, triplet: Triplet, arrays: Iterable[tuple[FrameKey, Any]]) -> Frames:
    """Group a triplet's arrays, and check that they have the same size.

    Args:
        reader: the reader of the triplet.
        triplet: a target and its source frames.
        arrays: the arrays of `TripletDataset._keys`; objects with a shape, or None.

    Raises:
        DeuxError: there is no ground truth, or an array has another size than the target's image.
    """
    frames = Frames([], {})
    for key, array in arrays:
        if array is None:
            raise DeuxError(
                f"{reader.folder} has no ground truth of {triplet.target.sequence}: evaluation and supervised "
                "training need it."
            )
        if key.kind == "image":
            frames.images.append(array)
        else:
            frames.maps[key.kind] = array
    # Without source frames there is one image only.
    sources = zip(triplet.sources, frames.images[1:], strict=False)
    named = [(f"source frame {frame.name}", array) for frame, array in sources]
    named += [(kind.replace("_", " "), array) for kind, array in frames.maps.items()]
    sizes = [(name, tuple(array.shape[-2:])) for name, array in named]
    check_one_size(reader, triplet.target, tuple(frames.images[0].shape[-2:]), sizes)
    return frames


def _array(read: np.ndarray | Tensor | None) -> np.ndarray | None:
    return read.cpu().numpy() if isinstance(read, Tensor) else read


def _batch(sample: Mapping[str, np.ndarray], prepare: Prepare | None) -> Batch:
    """Convert a sample to float32 tensors, with colours in [0, 1]."""
    # NumPy rather than torch: for small arrays on a busy machine torch's threads wait for each other.
    images, motions, truth = sample["images"], sample.get("source_from_target"), sample.get("ground_truth")
    if images.dtype == np.uint8:
        images = images / np.float32(255.0)
    sparse = sample["sparse_depth"]
    shown = sample.get("input_sparse_depth", sparse)
    prepared = prepare_sample(prepare, np.ascontiguousarray(shown)) if prepare is not None else {}
    return Batch(
        image=torch.from_numpy(images[0]),
        sources=torch.from_numpy(images[1:]),
        sparse_depth=torch.from_numpy(sparse[None]),
        validity=torch.from_numpy((sparse > 0).astype(np.float32)[None]),
        input_sparse_depth=torch.from_numpy(shown[None]),
        intrinsics=torch.from_numpy(sample["intrinsics"].astype(np.float32)),
        source_from_target=None if motions is None else torch.from_numpy(motions.astype(np.float32)),
        ground_truth=None if truth is None else torch.from_numpy(truth[None]),
        prepared={name: torch.from_numpy(value) for name, value in prepared.items()},
    )


def _stack(tensors: Sequence[Tensor]) -> Tensor:
    return torch.from_numpy(np.stack([tensor.numpy() for tensor in tensors]))
