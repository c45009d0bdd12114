"""Names of files that stand in a file from outside: whether they can be names, and where they lead."""

import os

_LONGEST = 255
"""Bytes of a name that file systems take."""

_LONGEST_PATH = 1000
"""Characters of a relative path."""


def is_file_name(name: str) -> bool:
    """Whether a name can be that of a file or folder within a folder, and leads to no other one.

    Example:
        >>> [name for name in ("a b.png", "a/b.png", "..", "", "n" * 300) if is_file_name(name)]
        ['a b.png']
    """
    return name not in ("", ".", "..") and "\0" not in name and "/" not in name and _length(name) <= _LONGEST


def is_within(name: str) -> bool:
    """Whether a name is a relative path, of names that can be, that does not lead out of its folder.

    Example:
        >>> [name for name in ("a/b.png", "./a/../b.png", "../b.png", "/b.png", "") if is_within(name)]
        ['a/b.png', './a/../b.png']
    """
    path = os.path.normpath(name)
    return 0 < len(name) <= _LONGEST_PATH and not os.path.isabs(path) and all(map(is_file_name, path.split(os.sep)))


def _length(name: str) -> int:
    return len(name.encode(errors="surrogateescape")) if len(name) <= _LONGEST else len(name)
