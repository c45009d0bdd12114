"""Text files of numbers separated by spaces or commas, such as camera matrices and poses."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from deux.errors import DeuxError
from deux.io.atomic import read_bytes


def read_numbers(path: Path) -> np.ndarray:
    """Read all numbers of a text file, N float64.

    Raises:
        DeuxError: the file is missing or contains anything but numbers.
    """
    return as_numbers([word for line in read_lines(path) for word in line], path)


def read_lines(path: Path) -> list[list[str]]:
    """Read the words of a text file, line by line, without empty lines and comments (lines that begin with #).

    Raises:
        DeuxError: the file is missing.
    """
    lines = read_bytes(path).decode("utf-8-sig", errors="replace").splitlines()
    words = [line.replace(",", " ").split() for line in lines]
    return [line for line in words if line and not line[0].startswith("#")]


def as_numbers(words: Sequence[str] | Sequence[Sequence[str]], path: Path) -> np.ndarray:
    """Convert words, or lines with equal numbers of words, to float64.

    Raises:
        DeuxError: a word is not a number.
    """
    try:
        return np.array(words, dtype=np.float64)
    except (ValueError, OverflowError) as error:
        raise DeuxError(f"{path} is not a text file of numbers.") from error
