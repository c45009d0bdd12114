"""Folders that are looked through, links included, wherever these lead."""

import os
from collections.abc import Iterator
from pathlib import Path


def walk(folder: Path) -> Iterator[tuple[Path, list[str], list[str]]]:
    """As `os.walk` from the top, by name and through links, but into no folder twice.

    Links that lead in circles would otherwise never end. Hidden folders are left out.

    Yields:
        A folder, the names of those in it, which the caller may remove names from, and the names of its files.
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
