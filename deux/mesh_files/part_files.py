"""The files that a mesh file refers to: where they are on disk, and the images among them."""

import os
from collections.abc import Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path, PureWindowsPath
from urllib.parse import unquote

import cv2
import numpy as np
from PIL import Image

from deux.errors import DeuxError

_JPEG_END = b"\xff\xd9"
_16_BIT_MODES = ("I;16", "I;16B", "I;16L")


def find_part(name: str, owner: Path, *folders: Path) -> Path:
    r"""The file that `owner` calls `name`.

    Names are taken as they stand, then with backslashes as slashes, then without their percent-encoding. A name that
    is a path on the machine that wrote the file (`C:\work\wall.png`) also stands for a file of that name beside it.

    Args:
        name: a path relative to one of the folders, or an absolute one.
        owner: the file that refers to it, for the message.
        folders: where to look, the folder of `owner` unless there are any.

    Raises:
        DeuxError: there is no such file.
    """
    within = folders or (owner.parent,)
    name = name.strip().strip('"')
    slashed = name.replace("\\", "/")
    candidates = [name, slashed, unquote(slashed)]
    if os.path.isabs(slashed) or PureWindowsPath(name).drive:
        candidates += [slashed.rsplit("/", 1)[-1], unquote(slashed.rsplit("/", 1)[-1])]
    for candidate in candidates:
        for folder in within:
            if candidate and (folder / candidate).is_file():
                return folder / candidate
    raise DeuxError(f"{owner} needs {name}, which is not in {within[0]}: the two must be kept together.")


def read_texture(path: Path, longest: int | None = None) -> np.ndarray:
    """Read an image of any usual format as a texture, H x W x 3 uint8, row 0 at the top; transparency is left out.

    Args:
        path: the image file.
        longest: the most pixels that its longer side keeps; a larger image is halved until it fits, None keeps all.

    Raises:
        DeuxError: it cannot be read as an image.
    """
    try:
        with _images_of_any_size(), Image.open(path) as image:
            factor = reduction(image.size, longest)
            if factor == 1 and image.format == "JPEG" and image.mode == "RGB":
                content = path.read_bytes()
                if _JPEG_END in content[-1024:]:  # OpenCV takes a truncated file for a grey one, Pillow does not
                    return _decoded_jpeg(content)
            width, height = (max(1, side // factor) for side in image.size)
            if factor > 1 and image.format == "JPEG":
                image.draft("RGB", (width, height))  # decoded at a half, a quarter or an eighth of its size
            deep = image.mode in _16_BIT_MODES
            pixels = Image.fromarray((np.asarray(image) >> 8).astype(np.uint8)) if deep else image
            pixels = pixels.convert("RGB")
            if pixels.size != (width, height):
                pixels = pixels.resize((width, height), Image.Resampling.BOX)
            return np.asarray(pixels)
    except (OSError, ValueError, SyntaxError, cv2.error) as error:
        raise DeuxError(f"{path} cannot be read as an image: {error}.") from error


def _decoded_jpeg(content: bytes) -> np.ndarray:
    """As Pillow decodes it, bit for bit, in two fifths of its time."""
    flags = cv2.IMREAD_COLOR_RGB | cv2.IMREAD_IGNORE_ORIENTATION
    pixels = cv2.imdecode(np.frombuffer(content, np.uint8), flags)
    if pixels is None:
        raise ValueError("it is damaged")
    return pixels


def read_textures(paths: Iterable[Path], longest: int | None = None) -> dict[Path, np.ndarray]:
    """Read several images, each once, as `read_texture` does; on all processors."""
    distinct = list(dict.fromkeys(paths))
    with ThreadPoolExecutor(os.cpu_count()) as pool:  # decoding releases the interpreter's lock
        read = pool.map(lambda path: read_texture(path, longest), distinct)
        return dict(zip(distinct, read, strict=True))


def limited_texture(texture: np.ndarray, longest: int | None) -> np.ndarray:
    """A texture that is in memory already, halved as `read_texture` does it; the array itself if it is small."""
    factor = reduction(texture.shape[:2], longest)
    if factor == 1:
        return texture
    height, width = (max(1, side // factor) for side in texture.shape[:2])
    return cv2.resize(texture, (width, height), interpolation=cv2.INTER_AREA)


def reduction(size: tuple[int, ...], longest: int | None) -> int:
    """The power of two by which the sides of an image are divided so that the longer one is at most `longest`."""
    factor = 1
    while longest is not None and max(size) // factor > longest:
        factor *= 2
    return factor


@contextmanager
def _images_of_any_size() -> Iterator[None]:
    """Let Pillow read the atlases of scans, which have more pixels than it takes for harmless."""
    most, Image.MAX_IMAGE_PIXELS = Image.MAX_IMAGE_PIXELS, None
    try:
        yield
    finally:
        Image.MAX_IMAGE_PIXELS = most
