"""What hands out the jobs of an exploration (`collect.executor`), made by its name."""

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
"""The executors by name, imported only when chosen, so that one works without the other's libraries."""


def make_executor(name: str, options: Mapping[str, Any], processes: int = 1) -> Executor:
    """Make an executor by name.

    Args:
        name: one of `EXECUTORS` (`collect.executor`).
        options: of its constructor (`collect.executor_options`).
        processes: number of processes of the local executor (`collect.processes`); no other one is given it.

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
