"""Checks of file names from untrusted sources: whether they are valid and stay within a folder."""

import os

from deux.errors import DeuxError, shown

_LONGEST = 255
"""Greatest length of a file name in bytes."""

_ADDED = 16
"""Bytes that suffixes, including those of temporary files, add to a frame's name."""

_LONGEST_PATH = 1000
"""Greatest length of a relative path in characters."""


def is_file_name(name: str) -> bool:
    """Whether a name is a valid name of a file or folder within a folder.

    Example:
        >>> [name for name in ("a b.png", "a/b.png", "..", "", "n" * 300) if is_file_name(name)]
        ['a b.png']
    """
    return name not in ("", ".", "..") and "\0" not in name and "/" not in name and _length(name) <= _LONGEST


def is_within(name: str) -> bool:
    """Whether a name is a valid relative path that does not lead out of its folder.

    Example:
        >>> [name for name in ("a/b.png", "./a/../b.png", "../b.png", "/b.png", "") if is_within(name)]
        ['a/b.png', './a/../b.png']
    """
    path = os.path.normpath(name)
    return 0 < len(name) <= _LONGEST_PATH and not os.path.isabs(path) and all(map(is_file_name, path.split(os.sep)))


def is_frame_path(sequence: str, name: str) -> bool:
    """Whether `<sequence>/<name>` is a valid path of a frame within a folder; the sequence may be a path without "..".

    Example:
        >>> [is_frame_path(*frame) for frame in (("house/hall", "1"), ("../hall", "1"), ("hall", "../1"), ("", "1"))]
        [True, False, False, False]
    """
    if ".." in sequence.split("/"):  # otherwise two sequences could have the same folder
        return False
    return is_within(sequence) and is_file_name(name) and _length(name) <= _LONGEST - _ADDED


def check_frame_path(sequence: str, name: str, folder: object) -> None:
    """Raise DeuxError unless a frame's files can be written into a folder; see `is_frame_path`."""
    if not is_frame_path(sequence, name):
        raise DeuxError(
            f"the frame {shown(name)} of {shown(sequence)} cannot be written to {folder}: the reader must return a "
            "sequence that is a relative path without .. and a frame that is a valid file name."
        )


def _length(name: str) -> int:
    return len(name.encode(errors="surrogateescape")) if len(name) <= _LONGEST else len(name)
