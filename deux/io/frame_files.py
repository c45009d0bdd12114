"""The files of a folder as the frames of a video: listed in the order of time, and matched by their names."""

import re
from collections.abc import Collection, Iterable, Mapping
from pathlib import Path

from deux.errors import DeuxError, counted, plural
from deux.io.layout import natural_order

IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp")
DEPTH_SUFFIXES = (".png", ".npy")

_DIGITS = re.compile(r"\d+")


def list_files(folder: Path, suffixes: Collection[str], pattern: str = "*") -> dict[str, Path]:
    """The files of a folder by their names without the suffix, in `natural_order`; hidden files are left out.

    Args:
        folder: the folder; one that is not there has no files.
        suffixes: the endings that count, in lower case; upper case counts as well.
        pattern: a glob pattern that the names match.

    Raises:
        DeuxError: two files differ in their endings only.
    """
    found: dict[str, Path] = {}
    for path in sorted(folder.glob(pattern)):
        if path.suffix.lower() not in suffixes or path.name.startswith("."):
            continue
        if path.stem in found:
            raise DeuxError(f"{folder} holds both {found[path.stem].name} and {path.name}: a frame has one such file.")
        found[path.stem] = path
    return {stem: found[stem] for stem in sorted(found, key=natural_order)}


def matching(stems: Iterable[str], files: Mapping[str, Path]) -> dict[str, Path]:
    """Which of the files belongs to which frame.

    A frame's file has its name. Of the frames and files that are left then, the numbers in the names decide:
    rgb_00012 and depth_12 belong together, unless two files have the same numbers, or two frames those of one file, as
    left_12 and right_12 have.

    Args:
        stems: the frames' file names without suffix.
        files: as `list_files` gives them.

    Returns:
        The files by the frames' file names, without the frames that have none.
    """
    stems = list(stems)
    named = {stem: files[stem] for stem in stems if stem in files}
    left = [stem for stem in stems if stem not in named]
    wanted = {_numbers(stem) for stem in left}
    unused = [(_numbers(name), path) for name, path in files.items() if name not in named]
    numbered = [(numbers, path) for numbers, path in unused if numbers in wanted]
    by_number = dict(numbered)
    found = {stem: by_number[_numbers(stem)] for stem in left if _numbers(stem) in by_number}
    taken = {_numbers(stem) for stem in named} & by_number.keys()
    if len(by_number) < len(numbered) or len(set(found.values())) < len(found) or taken:
        return named  # numbers do not tell them apart
    return {stem: found.get(stem) or named[stem] for stem in stems if stem in found or stem in named}


def depthless_images(folder: Path, count: int, images: int) -> str:
    """The sentence for images of a folder to which no depth map belongs."""
    return f"{folder}: {count} of {counted(images, 'image')} {plural('has', count)} no depth, by name or number."


def _numbers(stem: str) -> tuple[int, ...]:
    return tuple(int(run) for run in _DIGITS.findall(stem))
