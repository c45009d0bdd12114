"""Reading of JSON files as plain values or as dataclasses."""

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
"""Greatest memory in bytes that a byte of JSON takes as Python objects."""


def read_json(path: Path) -> Any:
    """Read a JSON file.

    Raises:
        DeuxError: the file is missing or not JSON.
    """
    return decode_json(read_bytes(path), path)


def read_json_object(path: Path) -> dict[str, Any]:
    """Read a JSON file that contains an object.

    Raises:
        DeuxError: the file is missing, not JSON, or does not contain an object.
    """
    return checked_object(read_json(path), path)


def read_record(path: Path, target: Callable[..., T]) -> T:
    """Read a JSON file as a value of a given type; the fields of dataclasses are checked by their types.

    Args:
        path: the file.
        target: a dataclass, or a type such as `list[Round]` or `dict[str, float]`.

    Raises:
        DeuxError: the file is missing, not JSON, or has an unknown key or a value of the wrong type.
    """
    return checked_record(read_json(path), target, path)


def decode_json(content: bytes, path: Path) -> Any:
    """Decode the content of a JSON file; `path` is for messages. Raises as `read_json`."""
    check_memory(_OBJECT_BYTES * len(content), f"the JSON of {path}", "make it smaller")
    try:
        return json.loads(content)
    except RecursionError as error:
        raise DeuxError(f"{path} is damaged: its JSON is nested too deeply.") from error
    except ValueError as error:  # not JSON, not UTF-8, or a number with too many digits for Python
        raise DeuxError(f"{path} is damaged or not JSON: {error}.") from error


def checked_object(value: Any, where: object) -> dict[str, Any]:
    """Check that a value is a JSON object; `where` is its place in messages."""
    if not isinstance(value, dict):
        raise DeuxError(f"{where} contains {_KINDS.get(type(value), 'a value')} where a JSON object is expected.")
    return value


def checked_record(value: Any, target: Callable[..., T], where: object) -> T:
    """Convert a JSON value to a type; `where` is its place in messages. Raises as `read_record`."""
    try:
        return converted(value, target, "it")
    except DeuxError as error:
        raise DeuxError(f"{where} is damaged or of another version of deux: {error}") from error
    except RecursionError as error:
        raise DeuxError(f"{where} is damaged: it is nested too deeply.") from error


_KINDS = {list: "a list", str: "a text", int: "a number", float: "a number", bool: "true or false", type(None): "null"}
