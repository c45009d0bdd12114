"""A few frames of many, for what would take too long on all of them."""

from collections.abc import Sequence
from typing import TypeVar

import numpy as np

T = TypeVar("T")


def evenly_chosen(items: Sequence[T], most: int) -> list[T]:
    """At most `most` of the items, evenly over all, the first and the last among them; in their order.

    Example:
        >>> evenly_chosen("abcdefg", 3), evenly_chosen("ab", 3)
        (['a', 'd', 'g'], ['a', 'b'])
    """
    places = np.linspace(0, len(items) - 1, min(most, len(items))).round().astype(int)
    return [items[place] for place in np.unique(places)]
