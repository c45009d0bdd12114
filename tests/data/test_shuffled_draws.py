"""Draws of samples: a permutation an epoch, from the seed and the epoch alone."""

import numpy as np

from deux.data.shuffled_draws import ShuffledDraws


def test_every_epoch_is_a_new_permutation() -> None:
    draws = ShuffledDraws(20, seed=5)
    first, again = list(draws), list(draws)
    draws.set_epoch(1)
    second = list(draws)
    assert first == again
    assert first != second
    assert sorted(index for index, _ in second) == list(range(20))
    assert not {seed for _, seed in first} & {seed for _, seed in second}
    assert list(ShuffledDraws(20, seed=5, epoch=1)) == second
    assert list(ShuffledDraws(20, seed=6)) != first


def test_they_are_those_of_earlier_versions() -> None:
    rng = np.random.default_rng([5, 2])
    expected = list(zip(rng.permutation(9).tolist(), rng.integers(2**62, size=9).tolist(), strict=True))
    assert list(ShuffledDraws(9, seed=5, epoch=2)) == expected


def test_processes_draw_equally_many_items_and_none_twice() -> None:
    whole = list(ShuffledDraws(20, seed=5))
    parts = [ShuffledDraws(20, seed=5, rank=rank, world_size=3) for rank in range(3)]
    assert [len(part) for part in parts] == [len(list(part)) for part in parts] == [6, 6, 6]
    assert sorted(draw for part in parts for draw in part) == sorted(whole[:18])
