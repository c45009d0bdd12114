"""The order of the samples of a training, and the seeds of what is random in them."""

from collections.abc import Iterator
from itertools import islice

import numpy as np
from torch.utils.data import Sampler


class ShuffledDraws(Sampler[tuple[int, int]]):
    """Every index once an epoch in random order, each with the seed of its own crop and augmentation.

    Order and seeds depend on the seed and the epoch alone, so they are the same for any number of workers. Processes
    that train together share the items out; all get equally many, so a few are left out where they do not go round.

    Args:
        size: number of items.
        seed: seed of all epochs.
        epoch: number of the first epoch; Lightning sets those that follow.
        rank: number of this process among those that train together.
        world_size: number of processes that train together.
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
