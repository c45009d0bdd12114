"""Opening of images with Pillow, with a limit on their size by the available memory."""

import threading
from typing import IO

from PIL import Image

from deux.memory_budget import check_memory

FRAME_BYTES = 100
"""Memory in bytes per pixel of a frame: as stored and as floats, with its depth, its points and the cache."""

TEXTURE_BYTES = 12
"""Memory in bytes per pixel of a texture: decoded, stored and in the mip pyramid."""

_OPENING = threading.Lock()


def open_image(content: IO[bytes], what: str, bytes_per_pixel: float) -> Image.Image:
    """Open an image of any format that Pillow supports; its pixels are decoded on first access.

    Pillow's own limit is a number of pixels that texture atlases of scans exceed; here the limit is the memory.

    Args:
        content: the file.
        what: the name of the image in the message.
        bytes_per_pixel: memory that using the image takes, `FRAME_BYTES` or `TEXTURE_BYTES`; 0 for no check.

    Raises:
        DeuxError: the image is too large for the memory.
        PIL.UnidentifiedImageError: it is not an image; for damaged headers Pillow may raise other errors.
    """
    with _OPENING:  # the limit is a global variable of Pillow, and textures are read in several threads
        most, Image.MAX_IMAGE_PIXELS = Image.MAX_IMAGE_PIXELS, None
        try:
            image = Image.open(content)
        finally:
            Image.MAX_IMAGE_PIXELS = most
    check_pixels(image.size, what, bytes_per_pixel)
    return image


def check_pixels(size: tuple[int, int], what: str, bytes_per_pixel: float) -> None:
    """Raise DeuxError if an image of this width and height is too large for the memory."""
    width, height = size
    check_memory(int(width * height * bytes_per_pixel), f"{what}, of {width:,} x {height:,} pixels,", "make it smaller")
