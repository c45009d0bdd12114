"""Reader of the elements of PLY files as arrays: text or binary, with any byte order and properties.

Format: Greg Turk, "The PLY Polygon File Format", 1994.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np

from deux.compilation import compiled
from deux.errors import DeuxError, shown
from deux.io.atomic import read_bytes

_TYPES = {
    **dict.fromkeys(("char", "int8"), "i1"),
    **dict.fromkeys(("uchar", "uint8"), "u1"),
    **dict.fromkeys(("short", "int16"), "i2"),
    **dict.fromkeys(("ushort", "uint16"), "u2"),
    **dict.fromkeys(("int", "int32"), "i4"),
    **dict.fromkeys(("uint", "uint32"), "u4"),
    **dict.fromkeys(("float", "float32"), "f4"),
    **dict.fromkeys(("double", "float64"), "f8"),
    **dict.fromkeys(("int64", "long"), "i8"),
    **dict.fromkeys(("uint64", "ulong"), "u8"),
}
_FORMATS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}


class Ragged(NamedTuple):
    """The concatenated lists of a list property.

    Args:
        values: the items of all lists, in the type of the file.
        lengths: the number of items of each list, int64.
    """

    values: np.ndarray
    lengths: np.ndarray


PlyElement = Mapping[str, np.ndarray | Ragged]
"""The properties of an element by name, with one value or one list for each row."""


@dataclass
class _Property:
    name: str
    kind: str  # NumPy's type code without byte order
    count_kind: str | None = None  # type code of the list lengths; None for a single value


@dataclass
class _Element:
    name: str
    count: int
    properties: list[_Property] = field(default_factory=list)


@dataclass
class PlyHeader:
    """The header of a PLY file.

    Args:
        order: "<" or ">", the byte order of a binary file; "" for text.
        comments: the comments without the keyword.
        size: size of the header in bytes.
        elements: the elements in the order of the file.
    """

    order: str
    comments: list[str]
    size: int
    elements: list[_Element]


def read_ply_elements(path: Path) -> dict[str, PlyElement]:
    """Read all elements of a PLY file, such as "vertex" and "face", with all properties.

    Raises:
        DeuxError: the file is missing, truncated or not a PLY file.
    """
    content = read_bytes(path)
    try:
        header = _header(content)
        stream = _text_stream(content, header) if header.order == "" else np.frombuffer(content, np.uint8)
        position = 0 if header.order == "" else header.size
        found: dict[str, PlyElement] = {}
        for element in header.elements:
            found[element.name], position = _read_element(stream, position, element, header.order)
        return found
    except (ValueError, KeyError, IndexError, MemoryError) as error:
        raise DeuxError(f"{path} is damaged or not a .ply file: {error}.") from error


def read_ply_header(path: Path) -> PlyHeader:
    """Read only the header of a PLY file.

    Raises:
        DeuxError: the file is missing or not a PLY file.
    """
    lines = bytearray()
    try:
        with path.open("rb") as file:
            for line in file:
                lines += line
                if line.strip() == b"end_header" or not lines.startswith(b"ply"):
                    break
        return _header(bytes(lines))
    except OSError as error:
        raise DeuxError(f"{path} cannot be read: {error.strerror}.") from error
    except (ValueError, KeyError, IndexError) as error:
        raise DeuxError(f"{path} is damaged or not a .ply file: {error}.") from error


def _header(content: bytes) -> PlyHeader:
    if not content.startswith(b"ply"):
        raise ValueError("it does not begin with ply")
    order, comments, elements, position = None, [], [], 0
    while True:
        end = content.find(b"\n", position)
        if end < 0:
            raise ValueError("its header has no end")
        line = content[position:end].decode(errors="surrogateescape").strip()
        position = end + 1
        words = line.split()
        match words:
            case ["format", name, *_]:
                order = _FORMATS[name]
            case ["comment" | "obj_info", *_]:
                comments.append(line.partition(" ")[2].strip())
            case ["element", name, count]:
                elements.append(_Element(name, int(count)))
            case ["property", "list", count_kind, kind, name]:
                elements[-1].properties.append(_Property(name, _TYPES[kind], _TYPES[count_kind]))
            case ["property", kind, name]:
                elements[-1].properties.append(_Property(name, _TYPES[kind]))
            case ["end_header"]:
                break
            case ["ply"] | []:
                pass
            case _:
                raise ValueError(f"its header has a line {shown(line)}")
    if order is None:
        raise ValueError("its header has no format")
    return PlyHeader(order, comments, position, elements)


def _text_stream(content: bytes, header: PlyHeader) -> np.ndarray:
    """The numbers after the header of a text file, float64."""
    return np.fromstring(content[header.size :], sep=" ")


def _read_element(stream: np.ndarray, start: int, element: _Element, order: str) -> tuple[PlyElement, int]:
    """Read the properties of an element; also returns the position of the next element in the stream.

    In a text file the stream consists of numbers, in a binary file of bytes.
    """
    lists = np.array([p.count_kind is not None for p in element.properties], bool)
    if not lists.any():
        return _read_table(stream, start, element, order)
    text = order == ""
    counts = np.array([1 if text else np.dtype(p.count_kind or "u1").itemsize for p in element.properties], np.int64)
    items = np.array([1 if text else np.dtype(p.kind).itemsize for p in element.properties], np.int64)
    signed = np.array([(p.count_kind or "u")[0] == "i" for p in element.properties], bool)
    walk = _walk_text if text else _walk_binary
    places, lengths, end = walk(stream, start, element.count, lists, counts, items, signed, order == ">")
    if end < 0:
        raise ValueError(f"it ends before its last {element.name}")
    found: dict[str, np.ndarray | Ragged] = {}
    for column, item in enumerate(element.properties):
        values = _gather(stream, places[:, column], lengths[:, column], item.kind, order)
        found[item.name] = values if item.count_kind is None else Ragged(values, lengths[:, column].copy())
    return found, end


def _read_table(stream: np.ndarray, start: int, element: _Element, order: str) -> tuple[PlyElement, int]:
    """Read an element without list properties; see `_read_element`."""
    types = np.dtype([(p.name, order + p.kind) for p in element.properties])
    end = start + element.count * (len(element.properties) if order == "" else types.itemsize)
    if end > len(stream):
        raise ValueError(f"it ends before its last {element.name}")
    if order == "":
        table = stream[start:end].reshape(element.count, len(element.properties))
        return {p.name: _numbers(table[:, k], p.kind) for k, p in enumerate(element.properties)}, end
    rows = np.frombuffer(stream, types, element.count, start) if element.count else np.zeros(0, types)
    return {p.name: rows[p.name].astype(p.kind) for p in element.properties}, end


def _numbers(values: np.ndarray, kind: str) -> np.ndarray:
    """Convert the float64 numbers of a text file to the type of their property."""
    if kind[0] == "f":
        with np.errstate(over="ignore"):  # overflow gives infinity, for which the mesh reader raises an error
            return values.astype(kind)
    limits = np.iinfo(kind)
    if not (right := (values >= limits.min) & (values <= limits.max)).all():
        raise ValueError(f"it has the number {values[~right][0]:g} where the type {kind} is expected")
    return np.rint(values).astype(kind)


def _gather(stream: np.ndarray, places: np.ndarray, lengths: np.ndarray, kind: str, order: str) -> np.ndarray:
    """Read `lengths[i]` values from each position `places[i]` of the stream, concatenated."""
    size = 1 if order == "" else np.dtype(kind).itemsize
    copied = _copied(stream, places, lengths * size)
    if order == "":
        return _numbers(copied, kind)
    return copied.view(order + kind).astype(kind, copy=False)


@compiled(nogil=True)
def _copied(stream: np.ndarray, places: np.ndarray, lengths: np.ndarray) -> np.ndarray:
    """Copy `lengths[i]` entries of the stream from each position `places[i]`, concatenated."""
    result = np.empty(lengths.sum(), stream.dtype)
    end = 0
    for row in range(len(places)):
        for k in range(lengths[row]):
            result[end + k] = stream[places[row] + k]
        end += lengths[row]
    return result


@compiled(nogil=True)
def _walk_binary(
    stream: np.ndarray,
    start: int,
    rows: int,
    lists: np.ndarray,
    counts: np.ndarray,
    items: np.ndarray,
    signed: np.ndarray,
    big: bool,
) -> tuple[np.ndarray, np.ndarray, int]:
    """Find the position and the number of items of each property of each row.

    Args:
        stream: the bytes of the file.
        start: position of the first row.
        rows: number of rows.
        lists: whether each property is a list.
        counts: size in bytes of each property's list length.
        items: size in bytes of each property's items.
        signed: whether each property's list length is signed; negative lengths are invalid.
        big: whether the byte order is big-endian.

    Returns:
        Positions and lengths, rows x properties, and the end of the last row; -1 if the stream is too short.
    """
    places = np.zeros((rows, len(lists)), np.int64)
    lengths = np.ones((rows, len(lists)), np.int64)
    here = start
    for row in range(rows):
        for column in range(len(lists)):
            if lists[column]:
                size = counts[column]
                if here + size > len(stream):
                    return places, lengths, -1
                number = np.int64(0)
                for k in range(size):
                    number = number * 256 + np.int64(stream[here + k if big else here + size - 1 - k])
                if number < 0 or (signed[column] and number >> (8 * size - 1) & 1):
                    return places, lengths, -1
                lengths[row, column] = number
                here += size
            places[row, column] = here
            here += items[column] * lengths[row, column]
            if here > len(stream) or here < start:
                return places, lengths, -1
    return places, lengths, here


@compiled(nogil=True)
def _walk_text(
    stream: np.ndarray,
    start: int,
    rows: int,
    lists: np.ndarray,
    counts: np.ndarray,
    items: np.ndarray,
    signed: np.ndarray,
    big: bool,
) -> tuple[np.ndarray, np.ndarray, int]:
    """Find positions and lengths like `_walk_binary`, in the numbers of a text file."""
    places = np.zeros((rows, len(lists)), np.int64)
    lengths = np.ones((rows, len(lists)), np.int64)
    here = start
    for row in range(rows):
        for column in range(len(lists)):
            if lists[column]:
                if here >= len(stream) or not 0 <= stream[here] <= len(stream):
                    return places, lengths, -1
                lengths[row, column] = np.int64(stream[here])
                here += 1
            places[row, column] = here
            here += lengths[row, column]
            if here > len(stream):
                return places, lengths, -1
    return places, lengths, here
