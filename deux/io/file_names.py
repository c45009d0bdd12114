"""Names of files that stand in a file from outside: whether they can be names, and where they lead."""

import os

from deux.errors import DeuxError, shown

_LONGEST = 255
"""Bytes of a name that file systems take."""

_ADDED = 16
"""Bytes that a file's ending, and its temporary name while it is written, add to a frame's name."""

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


def is_frame_path(sequence: str, name: str) -> bool:
    """Whether `<sequence>/<name>` can be a frame's file within a folder: the sequence may be a path, without "..".

    Example:
        >>> [is_frame_path(*frame) for frame in (("house/hall", "1"), ("../hall", "1"), ("hall", "../1"), ("", "1"))]
        [True, False, False, False]
    """
    if ".." in sequence.split("/"):  # a way out and back in would give two sequences one folder
        return False
    return is_within(sequence) and is_file_name(name) and _length(name) <= _LONGEST - _ADDED


def check_frame_path(sequence: str, name: str, folder: object) -> None:
    """Raise DeuxError unless a frame's files can be written into a folder, as `is_frame_path` says."""
    if not is_frame_path(sequence, name):
        raise DeuxError(
            f"{folder} can hold no file of the frame {shown(name)} of {shown(sequence)}: the reader must give a "
            "sequence that is a relative path without .. and a frame that can be the name of a file."
        )


def _length(name: str) -> int:
    return len(name.encode(errors="surrogateescape")) if len(name) <= _LONGEST else len(name)
