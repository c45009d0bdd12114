"""The check that all arrays of a frame have the same size."""

from collections.abc import Iterable

from deux.contracts import FrameReference, Reader
from deux.errors import DeuxError, image_size

Size = tuple[int, ...]
"""Height and width in pixels."""


def check_one_size(reader: Reader, frame: FrameReference, image: Size, others: Iterable[tuple[str, Size]]) -> None:
    """Raise DeuxError if an array has another size than the frame's image.

    Args:
        reader: the reader of the frame.
        frame: the frame.
        image: the size of its image.
        others: name, such as "sparse depth", and size of each other array.
    """
    for name, size in others:
        if size != image:
            raise DeuxError(
                f"frame {frame.name} of {frame.sequence} in {reader.folder} has an image of {image_size(image)} "
                f"pixels and {name} of {image_size(size)}: they must have the same size."
            )
