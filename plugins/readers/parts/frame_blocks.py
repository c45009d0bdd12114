"""Videos divided into blocks of frames: training frames first, then validation, then test, with margins in between."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import NamedTuple

from deux.errors import counted, plural

NAMED = 5
"""Videos that a sentence names at most."""


class Division(NamedTuple):
    """How a sequence of items is divided.

    Args:
        validation: fraction in the validation split.
        test: fraction in the test split.
        margin: items between two splits that belong to neither.
        count: makes a number of items of a fraction of them.
    """

    validation: float
    test: float
    margin: int = 0
    count: Callable[[float], int] = round

    def blocks(self, items: int) -> dict[str, slice]:
        """The part of so many items that each split has."""
        end = items
        found = {}
        for split, fraction in (("test", self.test), ("validation", self.validation)):
            start = max(0, end - self.count(fraction * items))
            found[split] = slice(start, end)
            if start < end:
                end = max(0, start - self.margin)
        found["train"] = slice(0, end)
        return found

    def between(self, items: int) -> int:
        """How many of so many items the margins keep out of all splits."""
        return items - sum(block.stop - block.start for block in self.blocks(items).values())

    def untrained(self, lengths: Mapping[str, int], folder: Path) -> str | None:
        """The sentence for videos that are too short to have training frames; None where there are none.

        Args:
            lengths: frames of each video.
            folder: of the videos.
        """
        short = [video for video, frames in lengths.items() if not self.blocks(frames)["train"].stop]
        if not short:
            return None
        smaller = (self._replace(margin=margin) for margin in range(self.margin, -1, -1))
        enough = (one.margin for one in smaller if all(one.blocks(lengths[video])["train"].stop for video in short))
        margin = next(enough, None)
        remedy = "data.split_by=videos" if margin is None else f"data.margin={margin} or data.split_by=videos"
        others = f" and {counted(len(short) - NAMED, 'other')}" if len(short) > NAMED else ""
        has = f"{len(short)} of {counted(len(lengths), 'video')} {plural('has', len(short))}"
        return (
            f"{folder}: {has} no training frames ({', '.join(short[:NAMED])}{others}), as data.validation="
            f"{self.validation:g}, data.test={self.test:g} and data.margin={self.margin} take them all: {remedy} "
            "leaves some."
        )
