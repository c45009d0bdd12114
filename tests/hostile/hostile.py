"""Hostile files: a table of what to put into them, and a judge of what reading them may lead to.

A case is a file that is wrong on purpose and a call that reads it. The call may succeed, or raise DeuxError with one
line of text. It fails if it raises anything else, leaves a file behind, takes longer than `SECONDS` of processor time
or asks for more than `MEMORY`.
"""

import copy
import json
import random
import resource
import signal
import time
import traceback
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from deux.errors import DeuxError

SECONDS = 6.0
MEMORY = 1500 * 1024**2
"""Bytes of address space beyond what the process has: more than any of the small files needs."""

LONGEST = 2000
"""Characters of a sentence."""

VALUES = (
    None,
    True,
    False,
    -1,
    0,
    3,
    10**18,
    10**400,
    0.5,
    -1e300,
    float("nan"),
    float("inf"),
    "",
    "text",
    "a/" * 4000,
)
VALUES += ("../../outside.png", "/etc/hostname", "\0", [], [None], [[]], {}, {"": None})
"""One or more of each type of JSON, and names that lead out of a folder."""


@dataclass(frozen=True)
class Case:
    """One hostile file.

    Args:
        name: what is wrong with it.
        content: what is written to the file that the campaign's call reads.
    """

    name: str
    content: bytes


def changed_values(document: Any, values: Iterable[Any] = VALUES) -> Iterator[Case]:
    """A JSON document with each value in turn replaced by each of `values`, and left out."""
    values = tuple(values)
    for place in _places(document):
        for value in (*values, _LEFT_OUT):
            if place or value is not _LEFT_OUT:
                changed = _replaced(document, place, value)
                shown = "nothing" if value is _LEFT_OUT else repr(value)[:30]
                yield Case(f"{'.'.join(map(str, place)) or 'all'} is {shown}", json.dumps(changed).encode())


def damaged_bytes(content: bytes, number: int = 60) -> Iterator[Case]:
    """A file that is cut off, or in which one byte, or four, are others."""
    draw = random.Random(0)
    for end in sorted({0, 1, *(draw.randrange(len(content)) for _ in range(number // 3))}):
        yield Case(f"cut off at byte {end}", content[:end])
    for _ in range(number):
        place, size = draw.randrange(len(content)), draw.choice((1, 4))
        new = draw.choice((bytes(size), b"\xff" * size, draw.randbytes(size)))
        yield Case(f"bytes {new!r} at {place}", content[:place] + new + content[place + size :])


def texts(*values: str) -> Iterator[Case]:
    """Files of these texts."""
    yield from (Case(repr(value)[:60], value.encode()) for value in values)


NO_JSON = (
    *texts("", "null", "{", "[" * 100_000, '{"a":' * 100_000, "1e400", "9" * 5000, '"\\ud800"', "\ufeff{}"),
    Case("binary", bytes(range(256))),
)
"""Files that hold something else than a JSON object."""


@dataclass
class Campaign:
    """Runs cases and gathers what goes wrong.

    Args:
        folder: everything is written here.
        most: number of cases of one call of `run`, chosen evenly; None for all.
    """

    folder: Path
    most: int | None = None
    failures: list[str] = field(default_factory=list)
    count: int = 0

    def run(self, cases: Iterable[Case], file: Path, read: Callable[[], Any]) -> None:
        """Write each case's content to a file and read it."""
        chosen = list(cases)
        if self.most is not None and len(chosen) > self.most:
            chosen = [chosen[len(chosen) * k // self.most] for k in range(self.most)]
        for case in chosen:
            file.write_bytes(case.content)
            self.call(f"{file.name}: {case.name}", read)

    def call(self, name: str, read: Callable[[], Any]) -> None:
        """Judge one call."""
        self.count += 1
        before = self._files()
        problem = judged(read)
        if left := self._files() - before:
            problem = f"left behind: {sorted(map(str, left))[:3]}"
        if problem:
            self.failures.append(f"{name}: {problem}")

    def end(self) -> None:
        """Fail with the failures, grouped by their cause, if there are any."""
        print(f"{self.count} cases, {len(self.failures)} failures")
        causes = Counter(failure.partition(" <")[0].rpartition(": ")[2] for failure in self.failures)
        shown = "\n".join(self.failures[:40])
        assert not self.failures, f"{len(self.failures)} of {self.count} cases failed: {dict(causes)}\n{shown}"

    def _files(self) -> set[Path]:
        return set(self.folder.rglob("*"))


_LEFT_OUT = object()


def _places(document: Any, place: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    yield place
    items = (
        document.items() if isinstance(document, dict) else enumerate(document) if isinstance(document, list) else ()
    )
    for key, value in items:
        yield from _places(value, (*place, key))


def _replaced(document: Any, place: tuple[Any, ...], value: Any) -> Any:
    if not place:
        return value
    changed = copy.deepcopy(document)
    node = changed
    for key in place[:-1]:
        node = node[key]
    if value is _LEFT_OUT:
        del node[place[-1]]
    else:
        node[place[-1]] = value
    return changed


def judged(read: Callable[[], Any]) -> str | None:
    """What is wrong with what a call does; None if nothing is."""
    started = time.process_time()
    limits = resource.getrlimit(resource.RLIMIT_AS)
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    resource.setrlimit(resource.RLIMIT_AS, (pages * resource.getpagesize() + MEMORY, limits[1]))
    earlier = signal.signal(signal.SIGALRM, _hangs)
    signal.setitimer(signal.ITIMER_REAL, 60.0)
    try:
        read()
        said = None
    except DeuxError as error:
        said = str(error)
    except BaseException as error:
        if isinstance(error, KeyboardInterrupt):
            raise
        where = traceback.extract_tb(error.__traceback__)[-1]
        return f"{type(error).__name__} <{str(error)[:80]}> {Path(where.filename).name}:{where.lineno}"
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, earlier)
        resource.setrlimit(resource.RLIMIT_AS, limits)
    if (seconds := time.process_time() - started) > SECONDS:
        return f"took long <{seconds:.1f} s>"
    if said is not None and ("\n" in said or len(said) > LONGEST or not said.isprintable()):
        return f"no sentence <{said[:200]!r}>"
    if said is not None and ("Unable to allocate" in said or "MemoryError" in said or "bad_alloc" in said):
        return f"memory <{said[:200]!r}>"
    return None


def _hangs(signum: int, frame: Any) -> None:
    raise TimeoutError("it hangs")
