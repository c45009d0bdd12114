"""Recursive listing of folders that follows links."""

import os
from collections.abc import Iterator
from pathlib import Path


def walk(folder: Path) -> Iterator[tuple[Path, list[str], list[str]]]:
    """Walk a folder like `os.walk`, sorted by name and following links, but visiting every folder only once.

    This terminates even if links form cycles. Hidden folders are left out.

    Yields:
        A folder, the names of its subfolders, from which the caller may remove names, and the names of its files.
    """
    seen = set()
    for found, below, files in os.walk(folder, followlinks=True):
        state = os.stat(found)
        if (state.st_dev, state.st_ino) in seen:
            below.clear()
            continue
        seen.add((state.st_dev, state.st_ino))
        below[:] = sorted(name for name in below if not name.startswith("."))
        yield Path(found), below, files
