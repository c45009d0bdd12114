"""Division of videos into blocks of training, validation and test frames, with margins between them."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import NamedTuple

from deux.errors import counted, plural

NAMED = 5
"""Greatest number of videos that a message names."""


class Division(NamedTuple):
    """The division of a sequence of items into splits.

    Args:
        validation: fraction in the validation split.
        test: fraction in the test split.
        margin: number of items between two splits that belong to neither.
        count: rounds a fractional number of items.
    """

    validation: float
    test: float
    margin: int = 0
    count: Callable[[float], int] = round

    def blocks(self, items: int) -> dict[str, slice]:
        """The range of each split in a sequence of `items` items."""
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
        """The number of items in no split because of the margins."""
        return items - sum(block.stop - block.start for block in self.blocks(items).values())

    def untrained(self, lengths: Mapping[str, int], folder: Path) -> str | None:
        """The warning for videos that are too short to have training frames; None if there are none.

        Args:
            lengths: number of frames of each video.
            folder: the folder of the videos.
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
            f"{folder}: {has} no training frames ({', '.join(short[:NAMED])}{others}) with data.validation="
            f"{self.validation:g}, data.test={self.test:g} and data.margin={self.margin}: set {remedy} to leave some."
        )
