"""Whether a plugin fulfils the contract of its kind, said of its class before and of itself after it is made."""

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

_UNBEGUN = re.compile(r"before Module\.__init__\(\) call|has no attribute '_(parameters|buffers|modules|\w+_hooks)'")
"""What torch says of a module whose constructor has not called that of `nn.Module` yet."""


def check_class(plugin: Plugin, cls: Any) -> None:
    """Check what an entry point leads to: a class of its kind's contract whose constructor takes options by name.

    Raises:
        DeuxError: says what it is instead, or which parameter or method is wrong.
    """
    kind = KINDS[plugin.kind]
    # Imported here because the contracts bring torch, which `--help` and composition must not wait for.
    contract = getattr(importlib.import_module("deux.contracts"), kind.contract)
    said = plugin.called
    if not (isinstance(cls, type) and issubclass(cls, contract)):
        raise DeuxError(f"{said} is not a subclass of deux.contracts.{kind.contract}.")
    if missing := getattr(cls, "__abstractmethods__", None):
        raise DeuxError(f"{said} does not define {', '.join(sorted(missing))}.")
    _check_methods(said, cls, contract)
    if nameless := positional_only(cls):
        raise DeuxError(
            f"{said} takes {nameless[0]!r} by its place alone, and options are given by name: remove the / behind "
            "it from the constructor's parameters."
        )
    if unasked := [name for name in kind.given if not takes(cls, name)]:
        raise DeuxError(
            f"{said} does not take {unasked[0]!r}: the constructor of a {kind.noun} begins with "
            f"{', '.join(('self', *kind.given))}, and its options follow."
        )
    if lacking := [name for name in kind.common if not takes(cls, name)]:
        raise DeuxError(
            f"{said} has no option {lacking[0]!r}: its constructor takes {', '.join(kind.common)}, as that of every "
            f"{kind.noun} does, which files of the configuration set."
        )
    if taken := sorted(options(cls, kind.given).keys() & {"name", *kind.reserved}):
        where = kind.settings.format(name=plugin.name)
        raise DeuxError(
            f"{said} has an option called {taken[0]!r}, and {where}.{taken[0]} is an option of deux's own: give "
            "the plugin's another name."
        )


def _check_methods(said: str, cls: type, contract: type) -> None:
    """Raise DeuxError if a method of the contract cannot be called with the arguments that the contract gives it.

    These are the ones that have a place; what `**prepared` stands for is known only when a model prepares it.
    """
    for name, declared in vars(contract).items():
        own = inspect.getattr_static(cls, name)
        if (name.startswith("_") and name != "__call__") or not (
            inspect.isfunction(declared) and inspect.isfunction(own)
        ):
            continue
        parameters = inspect.signature(declared).parameters.values()
        placed = [one.name for one in parameters if one.kind is one.POSITIONAL_OR_KEYWORD]
        try:
            inspect.signature(own).bind(*placed)
        except TypeError:
            raise DeuxError(
                f"{said} defines {name}({', '.join(inspect.signature(own).parameters)}), and it is called as "
                f"{name}({', '.join(placed)}): give it these parameters."
            ) from None


@contextmanager
def module_begun(plugin: Plugin) -> Iterator[None]:
    """One sentence where the constructor of a torch module uses the module before `super().__init__()` was called."""
    try:
        yield
    except AttributeError as error:
        if not _UNBEGUN.search(str(error)):
            raise
        raise DeuxError(
            f"{plugin.called} uses a torch module that was not begun yet ({error}): the constructor of a module must "
            "begin with super().__init__()."
        ) from error


def check_made(plugin: Plugin, made: Any) -> None:
    """Check a plugin that was made: it has its contract's attributes, sets are frozensets and ranges are not empty.

    Raises:
        DeuxError: says which attribute is missing, or what it must hold.
    """
    kind = KINDS[plugin.kind]
    said = plugin.called
    if hasattr(type(made), "register_buffer") and "_parameters" not in vars(made):
        raise DeuxError(f"{said} is a torch module that was not begun: its constructor must call super().__init__().")
    if missing := [name for name in kind.attributes if not _has(made, name)]:
        raise DeuxError(f"{said} has no {' and no '.join(missing)}: its class or its constructor sets them.")
    if kind.ascending is not None:
        _check_range(said, made, *kind.ascending)
    for attribute, member in kind.declared:
        cls: Any = str if member == "str" else getattr(importlib.import_module("deux.contracts"), member)
        found = getattr(made, attribute)
        if not isinstance(found, frozenset) or not all(isinstance(one, cls) for one in found):
            wanted = "text" if cls is str else f"deux.contracts.{member}"
            example = '"prior"' if cls is str else f"{member}.{next(iter(cls)).name}"
            raise DeuxError(
                f"{said} has {attribute} = {shown(found)}: it must be a frozenset of {wanted}, as in {attribute} = "
                f"frozenset({{{example}}})."
            )


def _check_range(said: str, made: Any, low: str, high: str) -> None:
    """Raise DeuxError unless two attributes are numbers, the first 0 or more and below the second, which is finite."""
    least, most = getattr(made, low), getattr(made, high)
    numbers = all(isinstance(end, Real) and not isinstance(end, bool) for end in (least, most))
    if not (numbers and 0 <= least < most < math.inf):
        raise DeuxError(
            f"{said} has {low} = {shown(least)} and {high} = {shown(most)}: they must be finite numbers, "
            f"{low} 0 or more and less than {high}."
        )


def _has(made: Any, attribute: str) -> bool:
    """Whether an object has an attribute; a property, which may take long, is not asked."""
    missing = object()
    return inspect.getattr_static(made, attribute, missing) is not missing or hasattr(made, attribute)
