"""Reading of .npy and .npz files from untrusted sources: headers are checked before memory is allocated."""

import io
import math
import zipfile
from pathlib import Path
from typing import Any

import numpy as np

from deux.errors import DeuxError, error_text, shown
from deux.io.atomic import read_bytes
from deux.memory_budget import check_memory

_NUMBERS = "biufc"
"""The accepted kinds of dtype: numbers, but no objects, strings or records."""

_HEADERS: dict[tuple[int, int], Any] = {
    (1, 0): np.lib.format.read_array_header_1_0,
    (2, 0): np.lib.format.read_array_header_2_0,
}


def read_array(path: Path) -> np.ndarray:
    """Read a .npy file of numbers.

    Raises:
        DeuxError: the file is missing, damaged, or contains anything but numbers.
    """
    return decode_array(read_bytes(path), path)


def decode_array(content: bytes, path: Path) -> np.ndarray:
    """Decode the content of a .npy file; `path` is for messages. Raises as `read_array`."""
    stream = io.BytesIO(content)
    try:
        version = np.lib.format.read_magic(stream)
        if version not in _HEADERS:
            raise ValueError(f"its format has the version {version[0]}.{version[1]}")
        shape, fortran_order, dtype = _HEADERS[version](stream)
    except Exception as error:  # the header is a Python literal, whose parser raises many kinds of errors
        raise DeuxError(f"{path} is damaged or not a .npy file of numbers: {error_text(error)}.") from error
    if dtype.kind not in _NUMBERS or dtype.names is not None:
        raise DeuxError(f"{path} contains values of the type {shown(str(dtype))} where numbers are expected.")
    if not all(type(side) is int and side >= 0 for side in shape) or len(shape) > 32:
        raise DeuxError(f"{path} is damaged: its header states the shape {shown(shape)}.")
    count, start = math.prod(shape), stream.tell()
    if count * dtype.itemsize != len(content) - start:
        raise DeuxError(
            f"{path} is damaged: its shape {shown(shape)} of {dtype} needs {shown(count * dtype.itemsize)} bytes, but "
            f"it contains {len(content) - start}."
        )
    values = np.frombuffer(content, dtype, count, start).reshape(shape, order="F" if fortran_order else "C")
    return values.copy(order="K")


def read_arrays(path: Path) -> dict[str, np.ndarray]:
    """Read all arrays of a .npz file, by name.

    Raises:
        DeuxError: the file is missing, damaged, too large for the memory when unpacked, or not a .npz file.
    """
    content = read_bytes(path)
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            members = archive.infolist()
            size = sum(member.file_size for member in members)
            check_memory(2 * size, f"{path}, which unpacks to {size / 2**30:,.1f} GiB,", "make it smaller")
            unpacked = {member.filename.removesuffix(".npy"): _unpacked(archive, member) for member in members}
    except DeuxError:
        raise
    except Exception as error:  # zipfile and zlib raise many kinds of errors
        raise DeuxError(f"{path} is damaged or not a .npz file of arrays: {error_text(error)}.") from error
    return {name: decode_array(data, path) for name, data in unpacked.items()}


def _unpacked(archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> bytes:
    """A member's content, at most of the size that the archive states."""
    with archive.open(member) as stream:
        return stream.read(member.file_size)
