"""CSV tables from outside, whose columns have names."""

import csv
import io
from pathlib import Path

from deux.errors import DeuxError, shown
from deux.io.arrays import said
from deux.io.atomic import read_bytes


def read_table(path: Path, *columns: str) -> list[dict[str, str]]:
    """Read a table with a line of names and a line for each row.

    Args:
        path: the file, UTF-8.
        columns: names that it must have.

    Returns:
        The rows by name; a row may lack its last values, which are then "".

    Raises:
        DeuxError: the file is missing, is no text, or lacks a column.
    """
    try:
        reader = csv.DictReader(io.StringIO(read_bytes(path).decode(), newline=""), restval="", restkey="")
        rows = list(reader)
    except (UnicodeDecodeError, csv.Error) as error:
        raise DeuxError(f"{path} is damaged or no table: {said(error)}.") from error
    if missing := [name for name in columns if name not in (reader.fieldnames or ())]:
        raise DeuxError(f"{path} is damaged: it has no column {missing[0]}.")
    return rows


def number(row: dict[str, str], column: str, path: Path) -> float:
    """The number in a column of a row.

    Raises:
        DeuxError: there is none.
    """
    try:
        return float(row[column])
    except ValueError as error:
        raise DeuxError(
            f"{path} is damaged: its column {column} holds {shown(row[column])} where a number is."
        ) from error
