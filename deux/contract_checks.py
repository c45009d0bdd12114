"""Checks that a plugin fulfils its kind's contract: of the class when it is loaded, of the instance when created."""

from __future__ import annotations

import importlib
import inspect
import math
import re
from collections.abc import Iterator
from contextlib import contextmanager
from numbers import Real
from typing import Any

from deux.errors import DeuxError, shown
from deux.options import options, positional_only, takes
from deux.plugin_kinds import KINDS, Plugin

_UNINITIALISED = re.compile(
    r"before Module\.__init__\(\) call|has no attribute '_(parameters|buffers|modules|\w+_hooks)'"
)
"""torch's messages about modules that are used before `nn.Module.__init__` was called."""


def check_class(plugin: Plugin, cls: Any) -> None:
    """Check an entry point's object: a subclass of its kind's contract, whose constructor takes options by name.

    Raises:
        DeuxError: it is something else, or a parameter or method is wrong.
    """
    kind = KINDS[plugin.kind]
    # Imported here because the contracts import torch, which `--help` and composition must not wait for.
    contract = getattr(importlib.import_module("deux.contracts"), kind.contract)
    called = plugin.called
    if not (isinstance(cls, type) and issubclass(cls, contract)):
        raise DeuxError(f"{called} is not a subclass of deux.contracts.{kind.contract}.")
    if missing := getattr(cls, "__abstractmethods__", None):
        raise DeuxError(f"{called} does not define {', '.join(sorted(missing))}.")
    _check_methods(called, cls, contract)
    if nameless := positional_only(cls):
        raise DeuxError(
            f"{called} has the positional-only parameter {nameless[0]!r}, but options are passed by name: remove the / "
            "after it from the constructor's parameters."
        )
    if untaken := [name for name in kind.given if not takes(cls, name)]:
        raise DeuxError(
            f"{called} does not take {untaken[0]!r}: the constructor of a {kind.noun} begins with "
            f"{', '.join(('self', *kind.given))}, and its options follow."
        )
    if lacking := [name for name in kind.common if not takes(cls, name)]:
        raise DeuxError(
            f"{called} has no option {lacking[0]!r}: the constructor of every {kind.noun} takes "
            f"{', '.join(kind.common)}, which the configuration files set."
        )
    if taken := sorted(options(cls, kind.given).keys() & {"name", *kind.reserved}):
        where = kind.settings.format(name=plugin.name)
        raise DeuxError(
            f"{called} has an option called {taken[0]!r}, and {where}.{taken[0]} is an option of deux's own: rename "
            "the plugin's."
        )


def _check_methods(called: str, cls: type, contract: type) -> None:
    """Raise DeuxError if a method cannot be called with the positional arguments that the contract declares.

    Keyword arguments such as `**prepared` are known only when a model prepares them.
    """
    for name, declared in vars(contract).items():
        own = inspect.getattr_static(cls, name)
        if (name.startswith("_") and name != "__call__") or not (
            inspect.isfunction(declared) and inspect.isfunction(own)
        ):
            continue
        parameters = inspect.signature(declared).parameters.values()
        positional = [one.name for one in parameters if one.kind is one.POSITIONAL_OR_KEYWORD]
        try:
            inspect.signature(own).bind(*positional)
        except TypeError:
            raise DeuxError(
                f"{called} defines {name}({', '.join(inspect.signature(own).parameters)}), and it is called as "
                f"{name}({', '.join(positional)}): give it these parameters."
            ) from None


@contextmanager
def module_initialised(plugin: Plugin) -> Iterator[None]:
    """Turn torch's error about a module used before `super().__init__()` into a DeuxError that says so."""
    try:
        yield
    except AttributeError as error:
        if not _UNINITIALISED.search(str(error)):
            raise
        raise DeuxError(
            f"{plugin.called} uses a torch module that is not initialised yet ({error}): the constructor of a module "
            "must begin with super().__init__()."
        ) from error


def check_instance(plugin: Plugin, instance: Any) -> None:
    """Check a plugin's instance: it has its contract's attributes, sets are frozensets and ranges are not empty.

    Raises:
        DeuxError: an attribute is missing or has a wrong value, or a torch module is not initialised.
    """
    kind = KINDS[plugin.kind]
    called = plugin.called
    if hasattr(type(instance), "register_buffer") and "_parameters" not in vars(instance):
        raise DeuxError(f"{called} is an uninitialised torch module: its constructor must call super().__init__().")
    if missing := [name for name in kind.attributes if not _has(instance, name)]:
        raise DeuxError(f"{called} has no {' and no '.join(missing)}: its class or its constructor must set them.")
    if kind.ascending is not None:
        _check_range(called, instance, *kind.ascending)
    for attribute, member in kind.declared:
        cls: Any = str if member == "str" else getattr(importlib.import_module("deux.contracts"), member)
        found = getattr(instance, attribute)
        if not isinstance(found, frozenset) or not all(isinstance(one, cls) for one in found):
            wanted = "text" if cls is str else f"deux.contracts.{member}"
            example = '"prior"' if cls is str else f"{member}.{next(iter(cls)).name}"
            raise DeuxError(
                f"{called} has {attribute} = {shown(found)}: it must be a frozenset of {wanted}, as in {attribute} = "
                f"frozenset({{{example}}})."
            )


def _check_range(called: str, instance: Any, low: str, high: str) -> None:
    """Raise DeuxError unless two attributes are finite numbers, the first 0 or more and less than the second."""
    least, most = getattr(instance, low), getattr(instance, high)
    numbers = all(isinstance(end, Real) and not isinstance(end, bool) for end in (least, most))
    if not (numbers and 0 <= least < most < math.inf):
        raise DeuxError(
            f"{called} has {low} = {shown(least)} and {high} = {shown(most)}: they must be finite numbers, "
            f"{low} 0 or more and less than {high}."
        )


def _has(instance: Any, attribute: str) -> bool:
    """Whether an object has an attribute; a property, which may be slow, is not evaluated."""
    missing = object()
    return inspect.getattr_static(instance, attribute, missing) is not missing or hasattr(instance, attribute)
