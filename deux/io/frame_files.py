"""The files of a folder as the frames of a video: listed in the order of time, and matched by their names."""

import re
from collections.abc import Collection, Iterable, Mapping
from pathlib import Path

from deux.errors import DeuxError
from deux.io.layout import natural_order

IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg")
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

    A frame's file has its name. Where no file has the name of a frame, the numbers in the names decide: rgb_00012
    and depth_12 belong together, unless two files have the same numbers, or two frames those of one file, as left_12
    and right_12 have.

    Args:
        stems: the frames' file names without suffix.
        files: as `list_files` gives them.

    Returns:
        The files by the frames' file names, without the frames that have none.
    """
    stems = list(stems)
    if not any(stem in files for stem in stems):
        numbered = {_numbers(stem): path for stem, path in files.items()}
        found = {stem: numbered[_numbers(stem)] for stem in stems if _numbers(stem) in numbered}
        if len(numbered) < len(files) or len(set(found.values())) < len(found):  # numbers do not tell them apart
            return {}
        return found
    return {stem: files[stem] for stem in stems if stem in files}


def _numbers(stem: str) -> tuple[int, ...]:
    return tuple(int(run) for run in _DIGITS.findall(stem))
