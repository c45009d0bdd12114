"""Images, depth maps and label maps as PNG files.

Depth is stored as 16-bit PNG, metres x 256, 0 = none, which is how the VOID release and KITTI store it. 65535 is none
as well: sensors and recordings, such as those of 7-Scenes, write it where nothing was measured or the range ended.

Pillow reads and OpenCV writes. torchvision's own reading and writing of images is deprecated since 0.29 and will be
removed; its encoder knows 8 bits a channel only, and its decoder ends the process, by a fault in libpng's error path,
where a file is damaged and an error should say which.
"""

import io
from pathlib import Path

import cv2
import numpy as np

from deux.errors import DeuxError
from deux.io.atomic import read_bytes, write_atomically
from deux.io.image_opening import FRAME_BYTES, open_image

DEPTH_SCALE = 256.0
"""Stored depth values per metre."""

_LARGEST_CODE = np.iinfo(np.uint16).max
LARGEST_DEPTH = (_LARGEST_CODE - 1) / DEPTH_SCALE
"""In metres, the farthest that a file can hold."""

# Fast to write; on rendered and recorded frames run-length matching also gives the smaller files.
_PNG_OPTIONS = [cv2.IMWRITE_PNG_COMPRESSION, 1, cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_RLE]
_PNG_BEGIN = b"\x89PNG\r\n\x1a\n"
_PNG_END = b"IEND\xaeB`\x82"
_PNG_BIT_DEPTH, _PNG_COLOR_TYPE, _GREY = 24, 25, 0
"""Where the header says how many bits a channel has and which channels there are; the type of one channel."""
_16_BIT_MODES = ("I;16", "I;16B", "I")


def quantise_depth(depth: np.ndarray) -> np.ndarray:
    """Depth as it comes back from a file: rounded to 1/256 m, 0 where it is not finite or not representable.

    Args:
        depth: H x W, metres, 0 = none.

    Returns:
        H x W float32.
    """
    return _depth_code(depth).astype(np.float32) / np.float32(DEPTH_SCALE)


def write_image(path: Path, image: np.ndarray) -> None:
    """Write an H x W x 3 uint8 RGB image as PNG, atomically."""
    write_atomically(path, encode_image(image))


def encode_image(image: np.ndarray) -> bytes:
    """The PNG file of an H x W x 3 uint8 RGB image."""
    return _encode_png(cv2.cvtColor(image, cv2.COLOR_RGB2BGR))


def read_image(path: Path) -> np.ndarray:
    """Read an RGB image, H x W x 3 uint8.

    Raises:
        DeuxError: the file is missing, truncated, damaged or not an 8-bit RGB image.
    """
    return decode_image(read_bytes(path), path)


def decode_image(content: bytes, path: Path) -> np.ndarray:
    """As `read_image`, from a file's content; `path` is where it was read."""
    return _decode_png(content, path, ("RGB",), "an 8-bit RGB image")


def check_png(content: bytes, path: Path) -> None:
    """Refuse a PNG file that Pillow would read wrongly: one without its end, or colours of 16 bits a channel.

    Pillow is content once it has all pixels, and reads the upper 8 bits of 16. Cameras write 10, 12 or 14 bits into
    such files and the file does not say how many: the upper byte of 10 bits is 0 to 3. To guess the number from each
    picture would change its brightness with what it shows.

    Args:
        content: of a file of any kind; other kinds are let through.
        path: the file, for the message.

    Raises:
        DeuxError: it is such a file.
    """
    if not content.startswith(_PNG_BEGIN):
        return
    if _PNG_END not in content[-1024:] or len(content) <= _PNG_COLOR_TYPE:
        raise DeuxError(f"{path} is truncated ({len(content)} bytes).")
    if content[_PNG_BIT_DEPTH] == 16 and content[_PNG_COLOR_TYPE] != _GREY:
        raise DeuxError(
            f"{path} is an image of 16 bits a channel where 8 are expected: convert it, dividing by 257 if the picture "
            "fills the 16 bits, by 16 if it has 12 bits and by 4 if it has 10."
        )


def write_depth(path: Path, depth: np.ndarray) -> None:
    """Write H x W metres (0 = none) as 16-bit PNG, atomically. `quantise_depth` tells what reading returns."""
    write_atomically(path, encode_depth(depth))


def encode_depth(depth: np.ndarray) -> bytes:
    """The 16-bit PNG file of H x W metres (0 = none)."""
    return _encode_png(_depth_code(depth))


def read_depth(path: Path, scale: float = DEPTH_SCALE) -> np.ndarray:
    """Read a depth map, H x W float32 metres, 0 = none; `scale` is the number of stored values per metre.

    At every scale the stored values 0 and 65535 are none.

    Raises:
        DeuxError: the file is missing, truncated, damaged or not a 16-bit image of one channel.
    """
    return decode_depth(read_bytes(path), path, scale)


def decode_depth(content: bytes, path: Path, scale: float = DEPTH_SCALE) -> np.ndarray:
    """As `read_depth`, from a file's content; `path` is where it was read."""
    code = _decode_png(content, path, _16_BIT_MODES, "a 16-bit depth map")
    code[code == _LARGEST_CODE] = 0
    return code.astype(np.float32) / np.float32(scale)


def encode_fraction(fraction: np.ndarray) -> bytes:
    """The 16-bit PNG file of H x W fractions x 65535; what is above 0 stays above 0."""
    code = np.clip(np.rint(fraction.astype(np.float64) * _LARGEST_CODE), fraction > 0, _LARGEST_CODE)
    return _encode_png(code.astype(np.uint16))


def read_fraction(path: Path) -> np.ndarray:
    """Read H x W float32 in [0, 1] from a 16-bit PNG file of fractions x 65535.

    Raises:
        DeuxError: the file is missing, truncated, damaged or not a 16-bit image of one channel.
    """
    pixels = _decode_png(read_bytes(path), path, _16_BIT_MODES, "a 16-bit map of fractions")
    return pixels.astype(np.float32) / np.float32(_LARGEST_CODE)


def write_labels(path: Path, labels: np.ndarray) -> None:
    """Write H x W label indices (-1 = none) as 16-bit PNG of index + 1, atomically."""
    write_atomically(path, _encode_png((labels + 1).astype(np.uint16)))


def read_labels(path: Path) -> np.ndarray:
    """Read label indices, H x W int32, -1 = none.

    Raises:
        DeuxError: the file is missing, truncated, damaged or not a 16-bit image of one channel.
    """
    return _decode_png(read_bytes(path), path, _16_BIT_MODES, "a 16-bit label map").astype(np.int32) - 1


def _depth_code(depth: np.ndarray) -> np.ndarray:
    """Depth as uint16 multiples of 1/256 m."""
    code = np.rint(np.nan_to_num(depth.astype(np.float64), nan=0.0, posinf=0.0, neginf=0.0) * DEPTH_SCALE)
    return np.where((code < 0) | (code >= _LARGEST_CODE), 0, code).astype(np.uint16)


def _encode_png(pixels: np.ndarray) -> bytes:
    _, content = cv2.imencode(".png", pixels, _PNG_OPTIONS)
    return content.tobytes()


def _decode_png(content: bytes, path: Path, modes: tuple[str, ...], expected: str) -> np.ndarray:
    """Decode with Pillow, which refuses damaged files; some versions of OpenCV return what they could decode."""
    if not content.startswith(_PNG_BEGIN):
        kind = "truncated" if _PNG_BEGIN.startswith(content) else "no PNG file"
        raise DeuxError(f"{path} is {kind} ({len(content)} bytes): {expected} in PNG format is expected.")
    check_png(content, path)
    try:
        with open_image(io.BytesIO(content), str(path), FRAME_BYTES) as image:
            if image.mode in modes:
                return np.array(image)
            found = f"an image of mode {image.mode}"
    except DeuxError:
        raise
    except Exception as error:  # a damaged file fails in many ways, depending on where
        raise DeuxError(f"{path} is damaged ({len(content)} bytes): {error}.") from error
    raise DeuxError(f"{path} is {found} where {expected} is expected.")
