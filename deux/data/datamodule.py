"""The Lightning data module: a model's training, validation and test frames as batches."""

from collections.abc import Callable, Hashable, Iterator, Sequence

import torch
from lightning import LightningDataModule
from torch.utils.data import DataLoader

from deux.contracts import Batch, DepthModel, Reader
from deux.data.triplets import FrameCache, SampleSettings, ShuffledDraws, SourceFrames, TripletDataset, collate
from deux.errors import DeuxError


class TripletLoader(DataLoader[Batch]):
    """A loader whose errors read the same from a worker process as from this one.

    Where `ShuffledDraws` gives the order it can go on within an epoch: a checkpoint keeps `state_dict`.
    """

    _given = 0  # batches of this epoch

    def __iter__(self) -> Iterator[Batch]:  # type: ignore[override]
        self._given = 0
        try:
            for batch in super().__iter__():
                self._given += 1
                yield batch
        except DeuxError as error:
            # A worker's error arrives as its stack trace in text, of which the last line is the sentence.
            sentence = str(error).strip().splitlines()[-1].removeprefix("deux.errors.DeuxError: ")
            raise DeuxError(sentence) from None

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
    A loader, its worker processes and what these have cached are kept for as long as its datasets are the same.

    Args:
        model: says what the training needs: `supervised`, `augmentation`, `prepare`.
        train: readers of the datasets to train on. The list may be changed between epochs, with
            `Trainer(reload_dataloaders_every_n_epochs=1)`; the split of a dataset that is new in it is read then.
        validation: readers of the validation datasets.
        test: readers of the test datasets.
        batch_size: samples in a batch.
        crop: height and width of the samples, at random in training and from the middle elsewhere; None for all.
        seed: seed of order, crops and augmentation.
        num_workers: processes that prepare batches. With the cache, none is fastest on two cores.
        cache_bytes: bound of the memory for decoded files, in each process.
        offsets: the source frames, where a dataset does not list them.
        sources: whether training and validation read the source frames.
        poses: whether they read the frames' poses.
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
        num_workers: int = 0,
        cache_bytes: int = 2 * 1024**3,
        offsets: tuple[int, ...] = (-1, -2),
        sources: bool = True,
        poses: bool = True,
    ) -> None:
        super().__init__()
        self.train, self.validation, self.test = list(train), list(validation), list(test)
        self.batch_size, self.crop, self.seed, self.num_workers = batch_size, crop, seed, num_workers
        self._model = model
        self._offsets = offsets
        self._sources: SourceFrames = "needed" if sources else "unread"
        self._poses = poses
        self._cache = FrameCache(cache_bytes)
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
                ground_truth=self._model.supervised,
                sources=self._sources,
                poses=self._poses,
                augmentation=self._model.augmentation(),
                prepare=self._model.prepare,
            )
            dataset = TripletDataset(self.train, "train", settings, self._cache, self._offsets)
            sampler = ShuffledDraws(len(dataset), self.seed, epoch, rank, world_size)
            return self._loader(dataset, sampler, drop_last=len(sampler) >= self.batch_size)

        loader = self._kept("train", self.train, make)
        assert isinstance(loader.sampler, ShuffledDraws)
        loader.sampler.set_epoch(epoch)  # Lightning does so only after it has asked a new loader for its first batch
        return loader

    def val_dataloader(self) -> TripletLoader:
        """In order, the middle of each frame, with ground truth."""
        return self._evaluation_loader(self.validation, "validation", self._sources, self._poses)

    def test_dataloader(self) -> TripletLoader:
        """In order, the middle of each frame, with ground truth and without source frames."""
        return self._evaluation_loader(self.test, "test", sources="unread", poses=False)

    def _evaluation_loader(
        self, readers: Sequence[Reader], split: str, sources: SourceFrames, poses: bool
    ) -> TripletLoader:
        def make() -> TripletLoader:
            settings = SampleSettings(
                crop=self.crop, ground_truth=True, sources=sources, poses=poses, prepare=self._model.prepare
            )
            return self._loader(TripletDataset(readers, split, settings, self._cache, self._offsets))

        return self._kept(split, readers, make)

    def _kept(self, split: str, readers: Sequence[Reader], make: Callable[[], TripletLoader]) -> TripletLoader:
        """The loader of a split, made anew only if something has changed that it was made from."""
        made_from = (*readers, self.batch_size, self.crop, self.num_workers)
        if split not in self._loaders or self._loaders[split][0] != made_from:
            self._loaders.pop(split, None)  # ends the workers of the one before
            self._loaders[split] = made_from, make()
        return self._loaders[split][1]

    def _loader(
        self, dataset: TripletDataset, sampler: ShuffledDraws | None = None, drop_last: bool = False
    ) -> TripletLoader:
        return TripletLoader(
            dataset,
            self.batch_size,
            sampler=sampler,
            num_workers=self.num_workers,
            persistent_workers=self.num_workers > 0,
            collate_fn=collate,
            drop_last=drop_last,
            pin_memory=torch.cuda.is_available(),
        )
