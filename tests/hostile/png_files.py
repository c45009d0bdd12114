"""PNG files that are written without anything that reads them."""

import functools
import struct
import zlib


def chunk(kind: bytes, data: bytes) -> bytes:
    """A chunk of a PNG file."""
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


@functools.cache
def png(width: int, height: int, bits: int = 8, mode: int = 2) -> bytes:
    """A PNG file of zeros, written row by row; `mode` is 0 for grey and 2 for RGB."""
    pack = zlib.compressobj(1)
    row = bytes(1 + width * (3 if mode == 2 else 1) * bits // 8)
    data = b"".join(pack.compress(row) for _ in range(height)) + pack.flush()
    header = struct.pack(">IIBBBBB", width, height, bits, mode, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", data) + chunk(b"IEND", b"")
