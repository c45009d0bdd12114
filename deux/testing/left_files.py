"""Comparison of the files of two runs of a command."""

import hashlib
import json
from collections.abc import Iterator, Sequence
from fnmatch import fnmatch
from pathlib import Path
from typing import Any

from deux.io.locking import SUFFIX

TIMED = (
    "*/logs/*",
    "*/deux.log",
    "*/train_ddp_process_*.log",
    "*/seconds.json",
    "*/.hydra/*",
    "/command.*",
    f"*{SUFFIX}.*",
)
"""Patterns of files that depend on time or on the number of starts, which are not compared.

The last pattern matches a lock whose removal was interrupted by a kill; the next lock in its folder deletes it.
"""

_TIMED_KEYS = ("seconds",)
"""Entries of JSON files that contain times."""


def digests(folder: Path, varying: Sequence[str] = ()) -> dict[str, str]:
    """Compute digests of all files in a folder, without times in JSON files.

    Args:
        folder: the folder.
        varying: patterns (`fnmatch`) of the files whose content differs between runs, whose digest is empty. They are
            matched with the relative path after a leading `/`.

    Returns:
        The digests by relative path.
    """
    found = {}
    for path in sorted(folder.rglob("*")):
        name = path.relative_to(folder).as_posix()
        if path.is_symlink() or not path.is_file() or _matches(name, TIMED):
            continue
        found[name] = "" if _matches(name, varying) else hashlib.sha256(_timeless(path)).hexdigest()
    return found


def differences(unbroken: dict[str, str], resumed: dict[str, str]) -> list[str]:
    """Describe the differences between the `digests` of an uninterrupted and a resumed run."""
    return list(_differences(unbroken, resumed))


def _differences(unbroken: dict[str, str], resumed: dict[str, str]) -> Iterator[str]:
    for name in sorted(unbroken.keys() | resumed.keys()):
        if name not in resumed:
            yield f"{name} is missing"
        elif name not in unbroken:
            yield f"{name} is left over"
        elif unbroken[name] != resumed[name]:
            yield f"{name} differs"


def _matches(name: str, patterns: Sequence[str]) -> bool:
    return any(fnmatch(f"/{name}", pattern) for pattern in patterns)


def _timeless(path: Path) -> bytes:
    content = path.read_bytes()
    if path.suffix != ".json":
        return content
    return json.dumps(_without_times(json.loads(content))).encode()


def _without_times(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _without_times(entry) for key, entry in value.items() if key not in _TIMED_KEYS}
    return [_without_times(entry) for entry in value] if isinstance(value, list) else value
