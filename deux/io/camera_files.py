"""Reading of images, depth maps and camera matrices in common formats."""

import io
from pathlib import Path

import numpy as np
from PIL import Image

from deux.errors import DeuxError, error_text
from deux.io.arrays import read_array
from deux.io.atomic import read_bytes
from deux.io.calibration import checked_intrinsics, read_intrinsics
from deux.io.image_opening import FRAME_BYTES, open_image
from deux.io.images import DEPTH_SCALE, check_png, read_depth

ARRAY_SUFFIX = ".npy"

_FLOAT_FORMATS = (".tif", ".tiff", ".exr", ".pfm", ".hdr")

_8_BIT_MODES = ("1", "L", "LA", "La", "P", "PA", "RGB", "RGBA", "RGBa", "RGBX", "CMYK", "YCbCr", "HSV", "LAB")


def read_any_image(path: Path) -> np.ndarray:
    """Read an 8-bit image of any format that Pillow supports as RGB, H x W x 3 uint8; transparency is dropped.

    The EXIF orientation is ignored, because the intrinsics refer to the stored pixels.

    Raises:
        DeuxError: the file is missing, damaged, not an image, or does not have 8 bits per channel.
    """
    content = read_bytes(path)
    check_png(content, path)
    try:
        with open_image(io.BytesIO(content), str(path), FRAME_BYTES) as image:
            image.load()
            mode = image.mode
            if mode in _8_BIT_MODES:
                # Pillow would warn about a palette's transparency if it were converted directly.
                return np.array((image.convert("RGBA") if mode in ("P", "PA") else image).convert("RGB"))
    except DeuxError:
        raise
    except Exception as error:  # Pillow raises many kinds of errors for damaged files
        unknown = isinstance(error, Image.UnidentifiedImageError)
        reason = "Pillow does not support its format" if unknown else error_text(error)
        raise DeuxError(f"{path} cannot be read as an image, it is damaged or not an image: {reason}.") from error
    raise DeuxError(f"{path} is an image of mode {mode}: 8 bits per channel are expected, RGB or grey.")


def read_any_depth(path: Path, scale: float = DEPTH_SCALE) -> np.ndarray:
    """Read a depth map from a 16-bit PNG file, or from a .npy file in metres.

    Args:
        path: the file; its suffix determines the format.
        scale: stored values per metre of a PNG file.

    Returns:
        H x W float32 metres, 0 = none.

    Raises:
        DeuxError: the file is missing, damaged or of another format, or a value is negative or not finite.
    """
    if path.suffix.lower() in _FLOAT_FORMATS:
        raise DeuxError(
            f"{path} has a format that is not supported for depth: convert it to a {ARRAY_SUFFIX} file in metres, or "
            "to a 16-bit PNG file."
        )
    if path.suffix.lower() != ARRAY_SUFFIX:
        return read_depth(path, scale)
    depth = read_array(path)
    if depth.ndim != 2 or depth.size == 0:
        raise DeuxError(f"{path} has the shape {' x '.join(map(str, depth.shape))}: a depth map must be H x W.")
    if depth.dtype.kind != "f":
        raise DeuxError(
            f"{path} contains numbers of the type {depth.dtype}: a {ARRAY_SUFFIX} file must contain metres as floats."
        )
    if not (np.isfinite(depth).all() and (depth >= 0).all()):
        raise DeuxError(f"{path} contains negative or infinite numbers or NaN: depth must be in metres, 0 for none.")
    return depth.astype(np.float32)


def read_any_intrinsics(path: Path) -> np.ndarray:
    """Read a camera's intrinsics, 3 x 3 float64, from a text file of nine numbers or from a .npy file.

    Raises:
        DeuxError: the file is missing or does not contain the matrix of a pinhole camera.
    """
    if path.suffix.lower() != ARRAY_SUFFIX:
        return read_intrinsics(path)
    numbers = read_array(path)
    if numbers.dtype.kind not in "iuf":
        raise DeuxError(f"{path} contains values of the type {numbers.dtype}: intrinsics must be 3 x 3 numbers.")
    return checked_intrinsics(numbers.astype(np.float64), path)
