"""Images, depth maps and label maps as PNG files.

Depth is stored as 16-bit PNG, metres x 256, 0 = none, like the VOID release and KITTI. 65535 means none, too: some
sensors and datasets, such as 7-Scenes, write it for invalid pixels.

Images are read with Pillow and written with OpenCV. torchvision's image functions are deprecated since 0.29, write only
8 bits per channel, and crash the process for damaged files.
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
"""The largest depth in metres that a file can store."""

# Fast to write; for rendered and recorded frames run-length encoding also gives smaller files.
_PNG_OPTIONS = [cv2.IMWRITE_PNG_COMPRESSION, 1, cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_RLE]
_PNG_BEGIN = b"\x89PNG\r\n\x1a\n"
_PNG_END = b"IEND\xaeB`\x82"
_PNG_BIT_DEPTH, _PNG_COLOR_TYPE, _GREY = 24, 25, 0
"""Offsets of the bit depth and the colour type in the header; the colour type of grey images."""
_16_BIT_MODES = ("I;16", "I;16B", "I")


def quantise_depth(depth: np.ndarray) -> np.ndarray:
    """Round depth to the precision of files, 1/256 m; values that are not finite or not representable become 0.

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
    """Encode an H x W x 3 uint8 RGB image as PNG."""
    return _encode_png(cv2.cvtColor(image, cv2.COLOR_RGB2BGR))


def read_image(path: Path) -> np.ndarray:
    """Read an RGB image, H x W x 3 uint8.

    Raises:
        DeuxError: the file is missing, truncated, damaged or not an 8-bit RGB image.
    """
    return decode_image(read_bytes(path), path)


def decode_image(content: bytes, path: Path) -> np.ndarray:
    """Decode the content of an RGB image file; `path` is for messages. Raises as `read_image`."""
    return _decode_png(content, path, ("RGB",), "an 8-bit RGB image")


def check_png(content: bytes, path: Path) -> None:
    """Raise DeuxError for PNG files that Pillow would read wrongly: truncated files, and colours with 16 bits.

    Pillow does not notice a missing end after the pixels, and reads only the upper 8 of 16 bits. Cameras store 10, 12
    or 14 bits in 16-bit files that do not record the number, so the right scale is not known.

    Args:
        content: the content of a file; formats other than PNG are accepted.
        path: the file, for messages.
    """
    if not content.startswith(_PNG_BEGIN):
        return
    if _PNG_END not in content[-1024:] or len(content) <= _PNG_COLOR_TYPE:
        raise DeuxError(f"{path} is truncated ({len(content)} bytes).")
    if content[_PNG_BIT_DEPTH] == 16 and content[_PNG_COLOR_TYPE] != _GREY:
        raise DeuxError(
            f"{path} is an image of 16 bits per channel where 8 are expected: convert it, dividing by 257 if it uses "
            "all 16 bits, by 16 if it uses 12 bits and by 4 if it uses 10 bits."
        )


def write_depth(path: Path, depth: np.ndarray) -> None:
    """Write H x W metres (0 = none) as 16-bit PNG, atomically; values are rounded as by `quantise_depth`."""
    write_atomically(path, encode_depth(depth))


def encode_depth(depth: np.ndarray) -> bytes:
    """Encode H x W metres (0 = none) as 16-bit PNG."""
    return _encode_png(_depth_code(depth))


def read_depth(path: Path, scale: float = DEPTH_SCALE) -> np.ndarray:
    """Read a depth map, H x W float32 metres, 0 = none; `scale` is the number of stored values per metre.

    The stored values 0 and 65535 mean none.

    Raises:
        DeuxError: the file is missing, truncated, damaged or not a 16-bit image of one channel.
    """
    return decode_depth(read_bytes(path), path, scale)


def decode_depth(content: bytes, path: Path, scale: float = DEPTH_SCALE) -> np.ndarray:
    """Decode the content of a depth map file; `path` is for messages. Raises as `read_depth`."""
    code = _decode_png(content, path, _16_BIT_MODES, "a 16-bit depth map")
    code[code == _LARGEST_CODE] = 0
    return code.astype(np.float32) / np.float32(scale)


def encode_fraction(fraction: np.ndarray) -> bytes:
    """Encode H x W fractions as 16-bit PNG of fraction x 65535; fractions above 0 stay above 0."""
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
    """Convert depth to uint16 in metres x 256."""
    code = np.rint(np.nan_to_num(depth.astype(np.float64), nan=0.0, posinf=0.0, neginf=0.0) * DEPTH_SCALE)
    return np.where((code < 0) | (code >= _LARGEST_CODE), 0, code).astype(np.uint16)


def _encode_png(pixels: np.ndarray) -> bytes:
    _, content = cv2.imencode(".png", pixels, _PNG_OPTIONS)
    return content.tobytes()


def _decode_png(content: bytes, path: Path, modes: tuple[str, ...], expected: str) -> np.ndarray:
    """Decode with Pillow, which raises errors for damaged files; some versions of OpenCV return partial images."""
    if not content.startswith(_PNG_BEGIN):
        kind = "truncated" if _PNG_BEGIN.startswith(content) else "not a PNG file"
        raise DeuxError(f"{path} is {kind} ({len(content)} bytes): {expected} in PNG format is expected.")
    check_png(content, path)
    try:
        with open_image(io.BytesIO(content), str(path), FRAME_BYTES) as image:
            if image.mode in modes:
                return np.array(image)
            found = f"an image of mode {image.mode}"
    except DeuxError:
        raise
    except Exception as error:  # Pillow raises many kinds of errors for damaged files
        raise DeuxError(f"{path} is damaged ({len(content)} bytes): {error}.") from error
    raise DeuxError(f"{path} is {found} where {expected} is expected.")
