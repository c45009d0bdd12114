"""The files of a folder as the frames of a video: listed, in the order of time, and matched by their names."""

import re
from collections.abc import Collection, Iterable, Mapping
from itertools import zip_longest
from pathlib import Path

from deux.errors import DeuxError

IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg")
DEPTH_SUFFIXES = (".png", ".npy")

_DECIMAL = re.compile(r"\d+(\.\d+)?")
_DIGITS = re.compile(r"\d+")


def list_files(folder: Path, suffixes: Collection[str], pattern: str = "*") -> dict[str, Path]:
    """The files of a folder by their names without the suffix; hidden files are left out.

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
    return found


def sortable_names(stems: Iterable[str]) -> dict[str, str]:
    """A name for each frame such that names sort as text in the order of time.

    File names that are decimal numbers, such as time stamps in seconds, are ordered by their values; in others each
    run of digits counts as a whole number, so that frame_2 comes before frame_10. The names are the file names, with
    zeros filled in where their numbers differ in length.

    Args:
        stems: the file names without suffix.

    Returns:
        The file names by the frames' names, in the order of time.

    Raises:
        DeuxError: two file names stand for one number, such as 7 and 07.
    """
    stems = list(stems)
    named = _decimal_names(stems) if all(map(_DECIMAL.fullmatch, stems)) else _natural_names(stems)
    found: dict[str, str] = {}
    for name, stem in sorted(zip(named, stems, strict=True)):
        if name in found:
            raise DeuxError(f"The files {found[name]} and {stem} have one number: their order in time is not known.")
        found[name] = stem
    return found


def natural_order(names: Iterable[str]) -> list[str]:
    """Names of folders or files in the order of the numbers in them: room_2 before room_10."""
    return list(sortable_names(names).values())


def matching(stems: Iterable[str], files: Mapping[str, Path]) -> dict[str, Path]:
    """Which of the files belongs to which frame.

    A frame's file has its name. Where no file has the name of a frame, the numbers in the names decide: rgb_00012
    and depth_12 belong together.

    Args:
        stems: the frames' file names without suffix.
        files: as `list_files` gives them.

    Returns:
        The files by the frames' file names, without the frames that have none.
    """
    stems = list(stems)
    if not any(stem in files for stem in stems):
        numbered = {_numbers(stem): path for stem, path in files.items()}
        if len(numbered) < len(files):  # their numbers do not tell them apart
            return {}
        return {stem: numbered[_numbers(stem)] for stem in stems if _numbers(stem) in numbered}
    return {stem: files[stem] for stem in stems if stem in files}


def _decimal_names(stems: list[str]) -> list[str]:
    """Zeros before the whole part and after the fraction: 7.5 and 10.25 become 07.50 and 10.25."""
    parts = [stem.partition(".") for stem in stems]
    whole = max((len(part[0]) for part in parts), default=0)
    fraction = max((len(part[2]) for part in parts), default=0)
    return [f"{a.zfill(whole)}.{b.ljust(fraction, '0')}" if fraction else a.zfill(whole) for a, _, b in parts]


def _natural_names(stems: list[str]) -> list[str]:
    """Zeros before the n-th run of digits of each name, to the length of the longest n-th run."""
    widths: list[int] = []
    for stem in stems:
        runs = [len(run) for run in _DIGITS.findall(stem)]
        widths = [max(pair) for pair in zip_longest(widths, runs, fillvalue=0)]
    return [_padded(stem, widths) for stem in stems]


def _padded(stem: str, widths: list[int]) -> str:
    remaining = iter(widths)
    return _DIGITS.sub(lambda run: run[0].zfill(next(remaining)), stem)


def _numbers(stem: str) -> tuple[int, ...]:
    return tuple(int(run) for run in _DIGITS.findall(stem))
