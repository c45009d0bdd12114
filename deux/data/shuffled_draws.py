"""The sampler of training samples: their order, and a random seed for each."""

from collections.abc import Iterator
from itertools import islice

import numpy as np
from torch.utils.data import Sampler


class ShuffledDraws(Sampler[tuple[int, int]]):
    """Samples every index once per epoch in random order, with a seed for the item's crop and augmentation.

    Order and seeds depend only on the seed and the epoch, and not on the number of workers. Distributed training
    processes share the items; all get the same number, so that up to `world_size` - 1 items of an epoch are left out.

    Args:
        size: number of items.
        seed: random seed of all epochs.
        epoch: index of the first epoch; Lightning sets those that follow.
        rank: index of this training process.
        world_size: number of training processes.
    """

    def __init__(self, size: int, seed: int, epoch: int = 0, rank: int = 0, world_size: int = 1) -> None:
        self._size, self._seed, self._epoch = size, seed, epoch
        self._rank, self._world_size = rank, world_size
        self._skipped: dict[int, int] = {}

    def __len__(self) -> int:
        return self._size // self._world_size

    def __iter__(self) -> Iterator[tuple[int, int]]:
        rng = np.random.default_rng([self._seed, self._epoch])
        order, seeds = rng.permutation(self._size), rng.integers(2**62, size=self._size)
        mine = slice(self._rank, len(self) * self._world_size, self._world_size)
        return islice(zip(order[mine].tolist(), seeds[mine].tolist(), strict=True), self.skipped, None)

    def set_epoch(self, epoch: int) -> None:
        """Use the order and seeds of the given epoch from the next iteration on."""
        self._epoch = epoch

    @property
    def epoch(self) -> int:
        """The current epoch."""
        return self._epoch

    @property
    def skipped(self) -> int:
        """Number of items that are skipped at the beginning of the current epoch."""
        return self._skipped.get(self._epoch, 0)

    def skip(self, epoch: int, items: int) -> None:
        """Skip the first items of one epoch, to resume a training within it."""
        self._skipped = {epoch: items}
