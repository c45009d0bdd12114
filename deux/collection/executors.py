"""The executors of collection jobs (`collect.executor`), created by name."""

from collections.abc import Mapping
from importlib import import_module
from typing import Any

from deux.collection.jobs import Executor
from deux.errors import DeuxError, near_matches
from deux.options import construct

EXECUTORS = {
    "local": "deux.collection.local_execution:LocalExecutor",
    "ray": "deux.collection.ray_execution:RayExecutor",
}
"""The executors by name; each is imported only when chosen, since it may need optional libraries."""


def make_executor(name: str, options: Mapping[str, Any], processes: int = 1) -> Executor:
    """Create an executor by name.

    Args:
        name: one of `EXECUTORS` (`collect.executor`).
        options: options of its constructor (`collect.executor_options`).
        processes: number of processes of the local executor (`collect.processes`); ignored by others.

    Raises:
        DeuxError: the name is unknown, an option is wrong, or the executor's libraries are missing.
    """
    if name not in EXECUTORS:
        raise DeuxError(f"collect.executor cannot be {name!r}: {near_matches(name, EXECUTORS)}")
    module, _, attribute = EXECUTORS[name].partition(":")
    given = {"processes": processes} if name == "local" else {}
    made: Executor = construct(
        getattr(import_module(module), attribute), dict(options), "collect.executor_options", given
    )
    return made
