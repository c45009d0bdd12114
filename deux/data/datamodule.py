"""The Lightning data module: a model's training, validation and test frames as batches."""

import gc
import logging
import multiprocessing
import os
import resource
from collections.abc import Callable, Hashable, Iterator, Sequence

import torch
from lightning import LightningDataModule
from torch.utils.data import DataLoader

from deux.broken_contracts import broken_contract
from deux.contracts import Augmentation, Batch, DepthModel, Reader
from deux.data.augmentation import training_transforms
from deux.data.augmentation_settings import AugmentationSettings
from deux.data.cache_choice import (
    SHARE,
    CacheChoice,
    Placement,
    free_on_device,
    place,
    prepares_on_host,
)
from deux.data.device_cache import DeviceCache
from deux.data.frame_cache import FrameCache, Kind, MemoryCache, stored_bytes
from deux.data.shuffled_draws import ShuffledDraws
from deux.data.triplets import SampleSettings, SourceFrames, TripletDataset, collate
from deux.errors import DeuxError, shown
from deux.io.layout import SourceChoice
from deux.memory_budget import free_memory

log = logging.getLogger(__name__)

FREE_DESCRIPTORS = 24
"""File descriptors that must be free in a process whose batches are prepared by worker processes.

A tensor is sent between processes as an open file. A worker that cannot open another file loses its batch without an
error, and the main process waits for it forever.
"""


class TripletLoader(DataLoader[Batch]):
    """A data loader that raises the same errors with and without worker processes, and can be resumed within an epoch.

    With the sampler `ShuffledDraws`, `state_dict` holds the position in the epoch for the checkpoint.
    """

    _yielded = 0  # batches of this epoch

    def __iter__(self) -> Iterator[Batch]:  # type: ignore[override]
        self._yielded = 0
        if self.num_workers > 0:
            _check_open_files(self.num_workers)
        try:
            for batch in super().__iter__():
                self._yielded += 1
                yield batch
        except DeuxError as error:
            # The message of a worker's error is its stack trace, which ends with the original message.
            raise DeuxError(str(error).rpartition("deux.errors.DeuxError: ")[2].strip()) from None

    def state_dict(self) -> dict[str, int]:
        """The epoch, and how many of its items have been loaded."""
        if not isinstance(self.sampler, ShuffledDraws):
            return {}
        return {"epoch": self.sampler.epoch, "items": self.sampler.skipped + self._yielded * (self.batch_size or 1)}

    def load_state_dict(self, state: dict[str, int]) -> None:
        """Skip the items of the epoch that have been loaded; to be called before its first batch is requested."""
        if state and isinstance(self.sampler, ShuffledDraws):
            self.sampler.skip(state["epoch"], state["items"])


class TripletDataModule(LightningDataModule):
    """Training, validation and test batches for one depth model.

    Each loader reads only what it needs: ground truth in training only if the model is supervised, source frames and
    poses only if the objective compares frames. Targets without source frames are then left out of training and
    validation; the test loader has all frames of its split and reads no source frames. Distributed training processes
    (`Trainer(use_distributed_sampler=False)`) share the training frames and validate on all validation frames. A
    loader and its workers are reused while its datasets stay the same; when datasets are added, the cached frames
    are kept. Samples do not depend on the cache or the number of workers.

    Args:
        model: the depth model, whose `augmentation`, `prepare` and `supervised` are used.
        train: readers of the training datasets. The list may be changed between epochs with
            `Trainer(reload_dataloaders_every_n_epochs=1)`.
        validation: readers of the validation datasets.
        test: readers of the test datasets.
        batch_size: samples in a batch.
        crop: height and width of the samples: a random crop in training, a centre crop elsewhere; None for no crop.
        seed: random seed of the order, crops and augmentation.
        num_workers: worker processes that prepare batches; None for the default of `deux.data.cache_choice.place`.
        cache: where frames are cached. Test frames are read once and not cached.
        cache_bytes: capacity of the cache, on the device and in memory each; None for a part of the free memory.
        offsets: the recent source frames, as offsets from the target; unused if a dataset lists them.
        sources: whether training and validation read source frames.
        poses: whether training and validation read poses.
        choice: how source frames are chosen in training and validation.
        supervised: whether training reads ground truth for the losses; None for `model.supervised`.
        augmentation: the data augmentation beside the model's own.
    """

    def __init__(
        self,
        model: DepthModel,
        train: Sequence[Reader] = (),
        validation: Sequence[Reader] = (),
        test: Sequence[Reader] = (),
        batch_size: int = 8,
        crop: tuple[int, int] | None = None,
        seed: int = 0,
        num_workers: int | None = None,
        cache: CacheChoice = "auto",
        cache_bytes: int | None = None,
        offsets: tuple[int, ...] = (-1, -2),
        sources: bool = True,
        poses: bool = True,
        choice: SourceChoice = "recent",
        supervised: bool | None = None,
        augmentation: AugmentationSettings | None = None,
    ) -> None:
        super().__init__()
        self.train, self.validation, self.test = list(train), list(validation), list(test)
        self.batch_size, self.crop, self.seed, self.num_workers = batch_size, crop, seed, num_workers
        self._model = model
        self._offsets = offsets
        self._sources: SourceFrames = "needed" if sources else "unread"
        self._poses = poses
        self._source_choice = choice
        self._supervised = model.supervised if supervised is None else supervised
        self._augmentation = augmentation or AugmentationSettings()
        self._choice, self._cache_bytes = cache, cache_bytes
        self._caches: dict[str, FrameCache] = {}
        self._reserved: dict[str, int] = {}
        self._array_bytes: dict[tuple[Reader, Kind], int] = {}
        self._logged: set[str] = set()
        self._loaders: dict[str, tuple[Hashable, TripletLoader]] = {}

    def train_dataloader(self) -> TripletLoader:
        """Shuffled batches with random crops and augmentation."""
        epoch, rank, world_size = 0, 0, 1
        if self.trainer is not None:
            epoch, rank, world_size = self.trainer.current_epoch, self.trainer.global_rank, self.trainer.world_size

        def make() -> TripletLoader:
            settings = SampleSettings(
                crop=self.crop,
                training=True,
                ground_truth=self._supervised or self._augmentation.draws_points,
                sources=self._sources,
                poses=self._poses,
                augmentation=self._transforms(),
                prepare=self._model.prepare,
            )
            dataset = TripletDataset(self.train, "train", settings, offsets=self._offsets, choice=self._source_choice)
            sampler = ShuffledDraws(len(dataset), self.seed, epoch, rank, world_size)
            drop_last = len(sampler) >= self.batch_size
            return self._loader(dataset, self._set_cache("train", dataset), sampler, drop_last)

        loader = self._cached_loader("train", self.train, make)
        assert isinstance(loader.sampler, ShuffledDraws)
        loader.sampler.set_epoch(epoch)  # Lightning does so only after it has requested a new loader's first batch
        return loader

    def val_dataloader(self) -> TripletLoader:
        """Ordered batches of centre crops with ground truth."""
        return self._evaluation_loader(self.validation, "validation", self._sources, self._poses, self._source_choice)

    def test_dataloader(self) -> TripletLoader:
        """Ordered batches of centre crops with ground truth and without source frames."""
        return self._evaluation_loader(self.test, "test", sources="unread", poses=False, choice="recent")

    def _transforms(self) -> list[Augmentation]:
        """The augmentation of training samples."""
        scalable = self._poses or self._sources == "unread"
        depth_range = self._model.min_depth, self._model.max_depth
        own: object = self._model.augmentation()
        if not (isinstance(own, list | tuple) and all(map(callable, own))):
            wanted = "a tuple of transforms such as those of torchvision.transforms.v2: () for none"
            raise broken_contract(self._model, shown(own), wanted, "augmentation")
        return training_transforms(self._augmentation, own, depth_range, scalable)

    def _evaluation_loader(
        self, readers: Sequence[Reader], split: str, sources: SourceFrames, poses: bool, choice: SourceChoice
    ) -> TripletLoader:
        def make() -> TripletLoader:
            settings = SampleSettings(
                crop=self.crop, ground_truth=True, sources=sources, poses=poses, prepare=self._model.prepare
            )
            dataset = TripletDataset(readers, split, settings, offsets=self._offsets, choice=choice)
            return self._loader(dataset, self._set_cache(split, dataset))

        return self._cached_loader(split, readers, make)

    def _cached_loader(self, split: str, readers: Sequence[Reader], make: Callable[[], TripletLoader]) -> TripletLoader:
        """The loader of a split; made again only if its datasets or settings have changed."""
        made_from = (*readers, self.batch_size, self.crop, self.num_workers)
        if split not in self._loaders or self._loaders[split][0] != made_from:
            self._loaders.pop(split, None)  # ends the workers of the previous loader
            self._loaders[split] = made_from, make()
        return self._loaders[split][1]

    def _set_cache(self, split: str, dataset: TripletDataset) -> Placement:
        """Decide where the frames of a loader are cached, and set the cache of its dataset."""
        if split == "test":
            return Placement("none", self.num_workers or 0)
        device, keys, cache = self._device, dataset.keys, self._caches.get(split, FrameCache())
        wanted = [] if self._choice == "none" else keys
        size = stored_bytes(wanted, self._array_bytes)
        missing = stored_bytes((key for key in wanted if not cache.holds(key)), self._array_bytes)
        room_on_device = self._room(split, DeviceCache, free_on_device(device))
        room_in_memory = self._room(split, MemoryCache, free_memory() // self._local_processes)
        placement = place(
            self._possible_choice(device),
            size,
            device,
            room_on_device,
            room_in_memory,
            self.num_workers,
            self._local_processes,
            self._agreed,
        )
        if placement.cache == "none":
            cache = FrameCache()
        elif placement.cache == "device":
            cache = cache if isinstance(cache, DeviceCache) else DeviceCache(device, room_on_device)
            cache.capacity = room_on_device
        else:
            cache = cache if isinstance(cache, MemoryCache) else MemoryCache(room_in_memory)
            cache.capacity = room_in_memory
        cache.reserve(keys, missing)
        self._caches[split] = dataset.cache = cache
        self._reserved[split] = size
        return placement

    def _possible_choice(self, device: torch.device) -> CacheChoice:
        """The value of `data.cache`, or "memory" if samples need computations on the CPU."""
        if self._choice in ("memory", "none"):
            return self._choice
        if prepares_on_host(self._model):
            reason = f"{type(self._model).__name__} computes inputs on the CPU (prepare)"
        elif self._augmentation.draws_points:
            reason = "points are sampled on the CPU (training.augmentation.density)"
        else:
            return self._choice
        if device.type != "cpu" or self._choice == "device":
            self._log_once(f"{reason}: frames are cached in memory and not on the device.")
        return "memory"

    def _room(self, split: str, kind: type[FrameCache], free: int) -> int:
        """Bytes that a split's cache may take: a part of the memory that is free or cached, without other splits' part.

        Memory that is reserved for the caches of other splits counts as theirs before they have filled it.
        """
        there = {name: cache for name, cache in self._caches.items() if isinstance(cache, kind)}
        if self._cache_bytes is not None:
            total = self._cache_bytes
        else:
            total = int(SHARE * (free + sum(cache.size for cache in there.values())))
        return max(0, total - sum(self._reserved[name] for name in there if name != split))

    @property
    def _device(self) -> torch.device:
        """The training device; the CPU without a trainer."""
        return torch.device("cpu") if self.trainer is None else self.trainer.strategy.root_device

    @property
    def _local_processes(self) -> int:
        """Number of training processes on this machine."""
        return 1 if self.trainer is None else max(1, self.trainer.num_devices)

    def _agreed(self, decision: bool) -> bool:
        """Whether the decision is true in all training processes."""
        if self.trainer is None:
            return decision
        return bool(self.trainer.strategy.reduce_boolean_decision(decision, all=True))

    def _log_once(self, message: str) -> None:
        if message not in self._logged:
            self._logged.add(message)
            log.info(message)

    def _loader(
        self,
        dataset: TripletDataset,
        placement: Placement,
        sampler: ShuffledDraws | None = None,
        drop_last: bool = False,
    ) -> TripletLoader:
        workers = placement.num_workers
        forks = "fork" in multiprocessing.get_all_start_methods()
        return TripletLoader(
            dataset,
            self.batch_size,
            sampler=sampler,
            num_workers=workers,
            persistent_workers=workers > 0,
            multiprocessing_context="fork" if workers and forks else None,  # only forks share a memory cache
            worker_init_fn=_freeze_inherited_objects,
            collate_fn=collate,
            drop_last=drop_last,
            pin_memory=placement.cache != "device" and self._device.type == "cuda",
        )


def _freeze_inherited_objects(worker: int) -> None:
    """Exclude objects of the parent process from garbage collection in a worker.

    Tensors and CUDA graphs of an earlier training may be among them, and freeing these without a CUDA context, which a
    forked process does not have, crashes it.
    """
    gc.freeze()


def _check_open_files(workers: int) -> None:
    most, opened = resource.getrlimit(resource.RLIMIT_NOFILE)[0], len(os.listdir("/proc/self/fd"))
    if most != resource.RLIM_INFINITY and most - opened < FREE_DESCRIPTORS:
        raise DeuxError(
            f"training.num_workers={workers} needs {FREE_DESCRIPTORS} open files beside the {opened} that are open, "
            f"but the limit of this process is {most}: raise it, for example by ulimit -n 1024, or set "
            "training.num_workers=0."
        )
