"""JSON files from outside, as plain values or as the dataclasses that they are the text of."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

from deux.errors import DeuxError
from deux.io.atomic import read_bytes
from deux.memory_budget import check_memory
from deux.options import converted

T = TypeVar("T")

_OBJECT_BYTES = 30
"""Memory that a byte of JSON takes at most, as Python's objects."""


def read_json(path: Path) -> Any:
    """Read a JSON file.

    Raises:
        DeuxError: the file is missing, or is no JSON.
    """
    return decode_json(read_bytes(path), path)


def read_json_object(path: Path) -> dict[str, Any]:
    """Read a JSON file that holds an object.

    Raises:
        DeuxError: the file is missing, is no JSON, or holds something else.
    """
    return checked_object(read_json(path), path)


def read_record(path: Path, target: Callable[..., T]) -> T:
    """Read a JSON file as a value of some type: a dataclass, whose fields are checked by their types, or a list.

    Args:
        path: the file.
        target: a dataclass, or a type such as `list[Round]` or `dict[str, float]`.

    Raises:
        DeuxError: the file is missing, is no JSON, or holds another name or a value of another type.
    """
    return checked_record(read_json(path), target, path)


def decode_json(content: bytes, path: Path) -> Any:
    """As `read_json`, from a file's content; `path` is where it was read."""
    check_memory(_OBJECT_BYTES * len(content), f"the JSON of {path}", "make it smaller")
    try:
        return json.loads(content)
    except RecursionError as error:
        raise DeuxError(f"{path} is damaged: its JSON is nested too deep.") from error
    except ValueError as error:  # no JSON, no UTF-8, or a number of more digits than Python reads
        raise DeuxError(f"{path} is damaged or no JSON: {error}.") from error


def checked_object(value: Any, where: object) -> dict[str, Any]:
    """A value that must be a JSON object; `where` is what messages call the place."""
    if not isinstance(value, dict):
        raise DeuxError(f"{where} holds {_KINDS.get(type(value), 'a value')} where a JSON object is expected.")
    return value


def checked_record(value: Any, target: Callable[..., T], where: object) -> T:
    """A value of JSON as some type; `where` is what messages call the place. Raises as `read_record` does."""
    try:
        return converted(value, target, "it")
    except DeuxError as error:
        raise DeuxError(f"{where} is damaged or of another version of deux: {error}") from error
    except RecursionError as error:
        raise DeuxError(f"{where} is damaged: it is nested too deep.") from error


_KINDS = {list: "a list", str: "a text", int: "a number", float: "a number", bool: "true or false", type(None): "null"}
