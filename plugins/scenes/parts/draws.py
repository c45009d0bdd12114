"""Random numbers that are the same on every machine and with every version of NumPy."""

from collections.abc import Sequence
from typing import TypeVar
from zlib import crc32

import numpy as np

Option = TypeVar("Option")


class Draws:
    """A stream of random numbers.

    All methods use only `Generator.random`, the plain conversion of PCG64's bits to [0, 1), because the results of the
    generator's other methods may change between versions of NumPy.

    Args:
        seed: seed of the scene, 0 or more.
        stream: name of the stream. The streams of a seed are independent: a change of one (such as one more chair) does
            not change others (such as the textures).
    """

    def __init__(self, seed: int, stream: str) -> None:
        entropy = np.random.SeedSequence((seed, crc32(stream.encode())))
        self._generator = np.random.Generator(np.random.PCG64(entropy))

    def uniform(self, low: float, high: float) -> float:
        """A number in [low, high], rounded to three decimals."""
        return round(low + (high - low) * self._generator.random(), 3)

    def integer(self, low: int, high: int) -> int:
        """An integer from low to high, both included."""
        return low + int(self._generator.random() * (high - low + 1))

    def chance(self, probability: float) -> bool:
        """True with the given probability."""
        return bool(self._generator.random() < probability)

    def choice(self, options: Sequence[Option]) -> Option:
        """One of the options."""
        return options[self.integer(0, len(options) - 1)]

    def field(self, *shape: int) -> np.ndarray:
        """Independent numbers in [-1, 1), float32 of the given shape."""
        return (self._generator.random(shape) * 2.0 - 1.0).astype(np.float32)
