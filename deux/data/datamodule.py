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

FILES_ON_THE_WAY = 24
"""Files that a process must be able to open, beside those that are open, where worker processes prepare its batches.

Each tensor that one process hands to another is a file until it has arrived. A worker that can open no more loses its
batch without an error, and who asked for it waits for good.
"""


class TripletLoader(DataLoader[Batch]):
    """A loader whose errors read the same from a worker process as from this one.

    Where `ShuffledDraws` gives the order it can go on within an epoch: a checkpoint keeps `state_dict`.
    """

    _given = 0  # batches of this epoch

    def __iter__(self) -> Iterator[Batch]:  # type: ignore[override]
        self._given = 0
        if self.num_workers > 0:
            _check_open_files(self.num_workers)
        try:
            for batch in super().__iter__():
                self._given += 1
                yield batch
        except DeuxError as error:
            # A worker's error arrives as its stack trace in text, which ends with the sentence.
            raise DeuxError(str(error).rpartition("deux.errors.DeuxError: ")[2].strip()) from None

    def state_dict(self) -> dict[str, int]:
        """The epoch, and how many of its items have been given out."""
        if not isinstance(self.sampler, ShuffledDraws):
            return {}
        return {"epoch": self.sampler.epoch, "items": self.sampler.skipped + self._given * (self.batch_size or 1)}

    def load_state_dict(self, state: dict[str, int]) -> None:
        """Leave out the items of the epoch that have been given out; before its first batch is asked for."""
        if state and isinstance(self.sampler, ShuffledDraws):
            self.sampler.skip(state["epoch"], state["items"])


class TripletDataModule(LightningDataModule):
    """Batches for one depth model.

    Each loader reads what it must and no more: ground truth in training only if the model is supervised, source frames
    and poses only where the objective compares frames. Frames without source frames are then left out of training and
    validation; the test loader has every frame of its list and reads no source frames at all. Processes that train
    together (`Trainer(use_distributed_sampler=False)`) share the training frames out and validate on all of them.
    A loader, its worker processes and what is cached are kept for as long as its datasets are the same, and of other
    datasets the frames that are cached already. Samples are the same wherever frames are kept, whoever prepares them.

    Args:
        model: says what the training needs: `augmentation`, `prepare` and, unless `supervised` says it, `supervised`.
        train: readers of the datasets to train on. The list may be changed between epochs, with
            `Trainer(reload_dataloaders_every_n_epochs=1)`; the split of a dataset that is new in it is read then.
        validation: readers of the validation datasets.
        test: readers of the test datasets.
        batch_size: samples in a batch.
        crop: height and width of the samples, at random in training and from the middle elsewhere; None for all.
        seed: seed of order, crops and augmentation.
        num_workers: processes that prepare batches; None goes by `deux.data.cache_choice.place`.
        cache: where frames are kept. Test frames are read once, and never kept.
        cache_bytes: bound of what is kept, on the device and in memory; None goes by what is free there.
        offsets: the recent source frames, where a dataset does not list them.
        sources: whether training and validation read the source frames.
        poses: whether they read the frames' poses.
        choice: how their source frames are chosen.
        supervised: whether training reads the ground truth for the losses; None for what the model says.
        augmentation: how training samples differ from the frames, beside the model's own augmentation.
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
        self._promised: dict[str, int] = {}
        self._array_bytes: dict[tuple[Reader, Kind], int] = {}
        self._told: set[str] = set()
        self._loaders: dict[str, tuple[Hashable, TripletLoader]] = {}

    def train_dataloader(self) -> TripletLoader:
        """Shuffled, cropped at random and augmented."""
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
            return self._loader(dataset, self._placed("train", dataset), sampler, drop_last)

        loader = self._kept("train", self.train, make)
        assert isinstance(loader.sampler, ShuffledDraws)
        loader.sampler.set_epoch(epoch)  # Lightning does so only after it has asked a new loader for its first batch
        return loader

    def val_dataloader(self) -> TripletLoader:
        """In order, the middle of each frame, with ground truth."""
        return self._evaluation_loader(self.validation, "validation", self._sources, self._poses, self._source_choice)

    def test_dataloader(self) -> TripletLoader:
        """In order, the middle of each frame, with ground truth and without source frames."""
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
            return self._loader(dataset, self._placed(split, dataset))

        return self._kept(split, readers, make)

    def _kept(self, split: str, readers: Sequence[Reader], make: Callable[[], TripletLoader]) -> TripletLoader:
        """The loader of a split, made anew only if something has changed that it was made from."""
        made_from = (*readers, self.batch_size, self.crop, self.num_workers)
        if split not in self._loaders or self._loaders[split][0] != made_from:
            self._loaders.pop(split, None)  # ends the workers of the one before
            self._loaders[split] = made_from, make()
        return self._loaders[split][1]

    def _placed(self, split: str, dataset: TripletDataset) -> Placement:
        """Decide where the frames of a loader are kept, and give its dataset the cache."""
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
        self._promised[split] = size
        return placement

    def _possible_choice(self, device: torch.device) -> CacheChoice:
        """What the user asks for, but not the device where the model's further inputs are computed on the CPU."""
        if self._choice in ("memory", "none"):
            return self._choice
        if prepares_on_host(self._model):
            reason = f"{type(self._model).__name__} computes inputs on the CPU (prepare)"
        elif self._augmentation.draws_points:
            reason = "points are drawn on the CPU (training.augmentation.density)"
        else:
            return self._choice
        if device.type != "cpu" or self._choice == "device":
            self._say(f"{reason}: frames are kept in memory and not on the device.")
        return "memory"

    def _room(self, split: str, kind: type[FrameCache], free: int) -> int:
        """Bytes that a split's cache of some kind may take: its part of what is free and what caches have taken there.

        What the caches of other splits have been promised is theirs, also before they have filled it.
        """
        there = {name: cache for name, cache in self._caches.items() if isinstance(cache, kind)}
        if self._cache_bytes is not None:
            total = self._cache_bytes
        else:
            total = int(SHARE * (free + sum(cache.size for cache in there.values())))
        return max(0, total - sum(self._promised[name] for name in there if name != split))

    @property
    def _device(self) -> torch.device:
        """The device that trains; the CPU without a trainer."""
        return torch.device("cpu") if self.trainer is None else self.trainer.strategy.root_device

    @property
    def _local_processes(self) -> int:
        """Processes on this machine that train together."""
        return 1 if self.trainer is None else max(1, self.trainer.num_devices)

    def _agreed(self, decision: bool) -> bool:
        """Whether all processes that train together have come to this decision."""
        if self.trainer is None:
            return decision
        return bool(self.trainer.strategy.reduce_boolean_decision(decision, all=True))

    def _say(self, sentence: str) -> None:
        """Log a sentence once."""
        if sentence not in self._told:
            self._told.add(sentence)
            log.info(sentence)

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
            multiprocessing_context="fork" if workers and forks else None,  # a memory cache is shared by forks alone
            worker_init_fn=_leave_inherited_garbage,
            collate_fn=collate,
            drop_last=drop_last,
            pin_memory=placement.cache != "device" and self._device.type == "cuda",
        )


def _leave_inherited_garbage(worker: int) -> None:
    """Keep a worker from collecting what was unreachable when it was forked.

    Tensors and CUDA graphs of an earlier training may be among it, and freeing those without the card's context, which
    a fork does not have, ends the process.
    """
    gc.freeze()


def _check_open_files(workers: int) -> None:
    most, opened = resource.getrlimit(resource.RLIMIT_NOFILE)[0], len(os.listdir("/proc/self/fd"))
    if most != resource.RLIM_INFINITY and most - opened < FILES_ON_THE_WAY:
        raise DeuxError(
            f"training.num_workers={workers} takes {FILES_ON_THE_WAY} files beside the {opened} that are open, and a "
            f"process may open {most}: raise that, as by ulimit -n 1024, or take training.num_workers=0."
        )
