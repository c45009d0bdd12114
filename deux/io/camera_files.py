"""One frame in anybody's files: the image, depth maps and the camera matrix, in the formats that are common."""

import io
from pathlib import Path

import numpy as np
from PIL import Image

from deux.errors import DeuxError
from deux.io.arrays import read_array, said
from deux.io.atomic import read_bytes
from deux.io.calibration import checked_intrinsics, read_intrinsics
from deux.io.image_opening import FRAME_BYTES, open_image
from deux.io.images import DEPTH_SCALE, check_png, read_depth

ARRAY_SUFFIX = ".npy"

_FLOAT_FORMATS = (".tif", ".tiff", ".exr", ".pfm", ".hdr")

_8_BIT_MODES = ("1", "L", "LA", "La", "P", "PA", "RGB", "RGBA", "RGBa", "RGBX", "CMYK", "YCbCr", "HSV", "LAB")


def read_any_image(path: Path) -> np.ndarray:
    """Read an 8-bit image of any format that Pillow knows, H x W x 3 uint8; grey becomes RGB, transparency is dropped.

    The pixels are taken as they are stored, since the intrinsics belong to them: a camera's note that the picture
    is to be turned is not followed.

    Raises:
        DeuxError: the file is missing, damaged, no image, or has other than 8 bits a channel.
    """
    content = read_bytes(path)
    check_png(content, path)
    try:
        with open_image(io.BytesIO(content), str(path), FRAME_BYTES) as image:
            image.load()
            mode = image.mode
            if mode in _8_BIT_MODES:
                # A palette's transparency would be warned about, though the colours stay the same.
                return np.array((image.convert("RGBA") if mode in ("P", "PA") else image).convert("RGB"))
    except DeuxError:
        raise
    except Exception as error:  # a damaged file fails in many ways, depending on its format and where it is damaged
        raise DeuxError(
            f"{path} cannot be read as an image, it is damaged or something else: {_said(error)}."
        ) from error
    raise DeuxError(f"{path} is an image of mode {mode} where 8 bits a channel are expected: RGB or grey.")


def read_any_depth(path: Path, scale: float = DEPTH_SCALE) -> np.ndarray:
    """Read a depth map from a 16-bit PNG file, or from a .npy file of metres.

    Args:
        path: the file; its name tells the format.
        scale: stored values per metre of a PNG file.

    Returns:
        H x W float32 metres, 0 = none.

    Raises:
        DeuxError: the file is missing, damaged or of another kind, or a value is no distance.
    """
    if path.suffix.lower() in _FLOAT_FORMATS:
        raise DeuxError(
            f"{path} is of a format that depth is not read from: write it as a {ARRAY_SUFFIX} file of metres, or as a "
            "16-bit PNG file."
        )
    if path.suffix.lower() != ARRAY_SUFFIX:
        return read_depth(path, scale)
    depth = read_array(path)
    if depth.ndim != 2 or depth.size == 0:
        raise DeuxError(f"{path} has the shape {' x '.join(map(str, depth.shape))}: a depth map is H x W.")
    if depth.dtype.kind != "f":
        raise DeuxError(
            f"{path} holds numbers of the type {depth.dtype}: a {ARRAY_SUFFIX} file holds metres in floating point."
        )
    if not (np.isfinite(depth).all() and (depth >= 0).all()):
        raise DeuxError(f"{path} holds negative or infinite numbers or NaN: depth is in metres, with 0 for none.")
    return depth.astype(np.float32)


def read_any_intrinsics(path: Path) -> np.ndarray:
    """Read a camera's 3 x 3 float64 intrinsics from a text file of nine numbers or from a .npy file.

    Raises:
        DeuxError: the file is missing or its matrix is not that of a pinhole camera.
    """
    if path.suffix.lower() != ARRAY_SUFFIX:
        return read_intrinsics(path)
    numbers = read_array(path)
    if numbers.dtype.kind not in "iuf":
        raise DeuxError(f"{path} holds values of the type {numbers.dtype}, which are no intrinsics: 3 x 3 numbers are.")
    return checked_intrinsics(numbers.astype(np.float64), path)


def _said(error: Exception) -> str:
    """An error's message on one line, without the object in memory that Pillow names."""
    if isinstance(error, Image.UnidentifiedImageError):
        return "it has no format that Pillow knows"
    return said(error)
