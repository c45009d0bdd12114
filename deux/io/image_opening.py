"""Pictures from outside, opened with Pillow and refused by what their header says before a pixel is decoded."""

import threading
from typing import IO

from PIL import Image

from deux.memory_budget import check_memory

FRAME_BYTES = 100
"""Memory for each pixel of a frame: as it is stored and as floats, with its depth, its points and its cache."""

TEXTURE_BYTES = 12
"""Memory for each pixel of a texture: as it is decoded, as it is kept and in the pyramid of its halves."""

_OPENING = threading.Lock()


def open_image(content: IO[bytes], what: str, bytes_per_pixel: float) -> Image.Image:
    """Open a picture of any format that Pillow knows; its pixels are decoded when they are asked for.

    Pillow's own limit is a number of pixels, which the atlases of scans exceed; here it is the machine's memory.

    Args:
        content: the file.
        what: what the picture is called, for the message.
        bytes_per_pixel: memory that the use of it takes, `FRAME_BYTES` or `TEXTURE_BYTES`; 0 where the caller checks.

    Raises:
        DeuxError: it has more pixels than there is memory for.
        PIL.UnidentifiedImageError: it is no picture; a damaged header raises further errors of Pillow's.
    """
    with _OPENING:  # the limit is a variable of Pillow's module, and textures are read in several threads
        most, Image.MAX_IMAGE_PIXELS = Image.MAX_IMAGE_PIXELS, None
        try:
            image = Image.open(content)
        finally:
            Image.MAX_IMAGE_PIXELS = most
    check_pixels(image.size, what, bytes_per_pixel)
    return image


def check_pixels(size: tuple[int, int], what: str, bytes_per_pixel: float) -> None:
    """Raise DeuxError if a picture of this width and height takes more memory than there is for it."""
    width, height = size
    check_memory(int(width * height * bytes_per_pixel), f"{what}, of {width:,} x {height:,} pixels,", "make it smaller")
