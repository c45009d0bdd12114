"""Evenly spaced items of a sequence, for checks that would take too long on all frames."""

from collections.abc import Sequence
from typing import TypeVar

import numpy as np

T = TypeVar("T")


def evenly_chosen(items: Sequence[T], most: int) -> list[T]:
    """At most `most` evenly spaced items in their order, including the first and the last.

    Example:
        >>> evenly_chosen("abcdefg", 3), evenly_chosen("ab", 3)
        (['a', 'd', 'g'], ['a', 'b'])
    """
    places = np.linspace(0, len(items) - 1, min(most, len(items))).round().astype(int)
    return [items[place] for place in np.unique(places)]
