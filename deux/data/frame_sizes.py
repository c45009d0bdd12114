"""The check that what belongs to a frame is of one size, for training, prediction and export alike."""

from collections.abc import Iterable

from deux.contracts import FrameReference, Reader
from deux.errors import DeuxError, image_size

Size = tuple[int, ...]
"""Height and width in pixels."""


def check_one_size(reader: Reader, frame: FrameReference, image: Size, others: Iterable[tuple[str, Size]]) -> None:
    """Raise DeuxError if something has another size than a frame's image.

    Args:
        reader: of the frame.
        frame: the frame.
        image: the size of its image.
        others: what else there is, such as "sparse depth", and its size.
    """
    for name, size in others:
        if size != image:
            raise DeuxError(
                f"frame {frame.name} of {frame.sequence} in {reader.folder} has an image of {image_size(image)} "
                f"pixels and {name} of {image_size(size)}: they must be of one size."
            )
