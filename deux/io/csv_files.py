"""Reading of CSV tables with named columns."""

import csv
import io
from pathlib import Path

from deux.errors import DeuxError, error_text, shown
from deux.io.atomic import read_bytes


def read_table(path: Path, *columns: str) -> list[dict[str, str]]:
    """Read a table with a header line.

    Args:
        path: the file, UTF-8.
        columns: names of the required columns.

    Returns:
        The rows by column name; missing values at the end of a row are "".

    Raises:
        DeuxError: the file is missing, is not a text file, or lacks a column.
    """
    try:
        reader = csv.DictReader(io.StringIO(read_bytes(path).decode(), newline=""), restval="", restkey="")
        rows = list(reader)
    except (UnicodeDecodeError, csv.Error) as error:
        raise DeuxError(f"{path} is damaged or not a table: {error_text(error)}.") from error
    if missing := [name for name in columns if name not in (reader.fieldnames or ())]:
        raise DeuxError(f"{path} is damaged: it has no column {missing[0]}.")
    return rows


def number(row: dict[str, str], column: str, path: Path) -> float:
    """The number in a column of a row.

    Raises:
        DeuxError: the value is not a number.
    """
    try:
        return float(row[column])
    except ValueError as error:
        raise DeuxError(
            f"{path} is damaged: its column {column} contains {shown(row[column])} where a number is expected."
        ) from error
