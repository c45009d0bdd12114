"""Files of frames in folders: listed in the order of time, and matched by name or number."""

import re
from collections.abc import Collection, Iterable, Mapping
from pathlib import Path

from deux.errors import DeuxError, counted, plural
from deux.io.layout import natural_order

IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp")
DEPTH_SUFFIXES = (".png", ".npy")

_DIGITS = re.compile(r"\d+")


def list_files(folder: Path, suffixes: Collection[str], pattern: str = "*") -> dict[str, Path]:
    """List the files of a folder by their names without the suffix, in `natural_order`, without hidden files.

    Args:
        folder: the folder; if it does not exist, there are no files.
        suffixes: the accepted suffixes in lower case; upper case is accepted too.
        pattern: a glob pattern for the names.

    Raises:
        DeuxError: two files differ only in their suffix.
    """
    found: dict[str, Path] = {}
    for path in sorted(folder.glob(pattern)):
        if path.suffix.lower() not in suffixes or path.name.startswith("."):
            continue
        if path.stem in found:
            raise DeuxError(f"{folder} has both {found[path.stem].name} and {path.name}: delete one of the two.")
        found[path.stem] = path
    return {stem: found[stem] for stem in sorted(found, key=natural_order)}


def matching(stems: Iterable[str], files: Mapping[str, Path]) -> dict[str, Path]:
    """Match files with frames by name, and the remaining ones by number.

    The numbers in the names match rgb_00012 with depth_12. They are used only if they are unique: not if two files, or
    two frames such as left_12 and right_12, have the same numbers.

    Args:
        stems: the frames' file names without suffix.
        files: the files, see `list_files`.

    Returns:
        The files by the frames' file names, without frames that have no file.
    """
    stems = list(stems)
    named = {stem: files[stem] for stem in stems if stem in files}
    unnamed = [stem for stem in stems if stem not in named]
    wanted = {_numbers(stem) for stem in unnamed}
    unused = [(_numbers(name), path) for name, path in files.items() if name not in named]
    numbered = [(numbers, path) for numbers, path in unused if numbers in wanted]
    by_number = dict(numbered)
    found = {stem: by_number[_numbers(stem)] for stem in unnamed if _numbers(stem) in by_number}
    taken = {_numbers(stem) for stem in named} & by_number.keys()
    if len(by_number) < len(numbered) or len(set(found.values())) < len(found) or taken:
        return named  # the numbers are not unique
    return {stem: found.get(stem) or named[stem] for stem in stems if stem in found or stem in named}


def depthless_images(folder: Path, count: int, images: int) -> str:
    """The warning for images of a folder without a depth map."""
    return f"{folder}: {count} of {counted(images, 'image')} {plural('has', count)} no depth, by name or number."


def _numbers(stem: str) -> tuple[int, ...]:
    return tuple(int(run) for run in _DIGITS.findall(stem))
