"""Options from the configuration, checked against the constructor that they are passed to.

Plugins need no schema: an option's name, type and default are those of a parameter of the constructor.
"""

from __future__ import annotations

import dataclasses
import inspect
import re
import types
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import Any, Literal, TypeVar, Union, get_args, get_origin

from deux.errors import DeuxError, near_matches, shown
from deux.plain_settings import plain_options

T = TypeVar("T")

REQUIRED: Any = inspect.Parameter.empty
"""The default of an option that has none."""


@dataclass(frozen=True)
class Option:
    """One parameter of a constructor.

    Args:
        name: the parameter's name.
        annotation: its declared type; `Any` if there is none, a string if it cannot be resolved.
        default: its default, or `REQUIRED`.
    """

    name: str
    annotation: Any
    default: Any


def options(target: Callable[..., Any], given: Collection[str] = ()) -> dict[str, Option]:
    """The options of `target` by name, in the order of its parameters; parameters in `given` are not options."""
    named = (inspect.Parameter.POSITIONAL_OR_KEYWORD, inspect.Parameter.KEYWORD_ONLY)
    return {
        p.name: Option(p.name, Any if p.annotation is p.empty else p.annotation, p.default)
        for p in _signature(target).parameters.values()
        if p.kind in named and p.name not in given
    }


def positional_only(target: Callable[..., Any]) -> list[str]:
    """The positional-only parameters of `target`, which cannot be options."""
    return [p.name for p in _signature(target).parameters.values() if p.kind is p.POSITIONAL_ONLY]


def takes(target: Callable[..., Any], name: str) -> bool:
    """Whether `target` accepts a keyword argument of that name, by a parameter or by **kwargs."""
    return name in options(target) or is_open_ended(target)


def construct(
    target: Callable[..., T], settings: Mapping[str, Any], where: str, given: Mapping[str, Any] | None = None
) -> T:
    """Call `target` with options, after checking their names and types.

    Values are converted where that loses nothing: integers to floats, lists to tuples, mappings to dataclasses.

    Args:
        target: a class or function, such as a plugin's class or a dataclass of the framework.
        settings: values of options by name, plain or as OmegaConf nodes.
        where: their path in the configuration, such as "camera", or "" for the root; error messages begin with it.
        given: arguments that are not options, such as objects of the framework; they are passed unchecked.

    Raises:
        DeuxError: an option is unknown or of the wrong type, or a required one is missing.
    """
    filled = dict(given or {})
    return target(**filled, **_checked(target, settings, where, filled))


def converted(value: Any, annotation: Any, where: str) -> Any:
    """Convert a plain value to a type, checked as options are.

    Args:
        value: a plain value, such as from JSON.
        annotation: a simple type, an enum, a list, tuple or dict of these, or a dataclass.
        where: what error messages call the value.

    Raises:
        DeuxError: the value, or an element of it, is of another type.

    Example:
        >>> converted([1, 2], tuple[float, float], "size")
        (1.0, 2.0)
    """
    if dataclasses.is_dataclass(annotation):
        if not isinstance(value, Mapping):
            raise DeuxError(f"{where} must be {describe(Mapping)}, but is {shown(value)}.")
        return construct(annotation, value, "")  # type: ignore[arg-type]
    return _option_value(value, annotation, where)


def full_settings(
    target: Callable[..., Any], settings: Mapping[str, Any], where: str = "settings", given: Collection[str] = ()
) -> dict[str, Any]:
    """The settings together with the constructor's defaults, as JSON values in the order of the parameters.

    Equal settings give equal results however they were written (1 or 1.0, list or tuple), so hashes and saved
    configurations use them. Enum members are represented by their names, and other objects by their `str`.

    Raises:
        DeuxError: as `construct`; or a value's `str` differs from process to process, as that of a function does.
    """
    checked = _checked(target, settings, where, given)
    known = options(target, given)
    full = {name: checked.get(name, option.default) for name, option in known.items()}
    full.update({name: value for name, value in checked.items() if name not in known})
    written = {}
    for name, value in full.items():
        try:
            written[name] = _json(value)
        except _Mismatch:
            default = "" if name in checked else " by default"
            raise DeuxError(
                f"{where}.{name} of {getattr(target, '__name__', target)} is {shown(value)}{default}, whose text "
                "differs at each start, so that no dataset would be found again: make the option a number, text, an "
                "enum's member, a list or None, and create the object in the constructor."
            ) from None
    return written


def without_defaults(target: Callable[..., Any], settings: Mapping[str, Any]) -> dict[str, Any]:
    """The result of `full_settings` without the values that equal the constructor's defaults."""
    known = options(target)

    def is_default(name: str, value: Any) -> bool:
        try:
            return name in known and value == _json(known[name].default)
        except _Mismatch:
            return False

    return {name: value for name, value in settings.items() if not is_default(name, value)}


def describe(annotation: Any) -> str:
    """A type in words, for messages and listings: "a number", "text or null"."""
    words = {
        Any: "any value",
        bool: "true or false",
        int: "a whole number",
        float: "a number",
        str: "text",
        Path: "a path",
    }
    arguments = get_args(annotation)
    if annotation in (None, type(None)):
        return "null"
    if get_origin(annotation) is Literal:
        return " or ".join(repr(value) for value in arguments)
    if _is_enum(annotation):
        return " or ".join(member.name for member in annotation)
    if _is_union(annotation):
        return " or ".join(describe(argument) for argument in arguments)
    if _is_sequence(annotation):
        if get_origin(annotation) is tuple and Ellipsis not in arguments:
            return f"a list of {len(arguments)} values ({', '.join(map(describe, arguments))})"
        return f"a list (each {describe(arguments[0])})" if arguments else "a list"
    if _is_mapping(annotation):
        return f"names, each with {describe(arguments[1])}" if arguments else "names with values"
    if dataclasses.is_dataclass(annotation):
        return f"options by name ({', '.join(options(annotation))})"  # type: ignore[arg-type]
    return words[annotation] if annotation in words else str(getattr(annotation, "__name__", annotation))


class _Mismatch(Exception):
    """A value is not of the declared type."""


def _signature(target: Callable[..., Any]) -> inspect.Signature:
    try:
        return inspect.signature(target, eval_str=True)
    except NameError:  # an annotation that is imported for type checkers only
        return inspect.signature(target)


def is_open_ended(target: Callable[..., Any]) -> bool:
    """Whether `target` has a parameter such as **settings."""
    return any(p.kind is p.VAR_KEYWORD for p in _signature(target).parameters.values())


def _checked(
    target: Callable[..., Any], settings: Mapping[str, Any], where: str, given: Collection[str] = ()
) -> dict[str, Any]:
    """The settings as the declared types. Raises DeuxError as `construct` does."""
    known = options(target, given)
    open_ended = is_open_ended(target)
    name = getattr(target, "__name__", str(target))
    prefix = f"{where}." if where else ""
    result: dict[str, Any] = {}
    for key, value in plain_options(settings, where).items():
        if key in known:
            result[key] = _option_value(value, known[key].annotation, f"{prefix}{key}")
        elif open_ended:
            result[key] = value
        else:
            raise DeuxError(f"{prefix}{key} is not an option of {name}: {near_matches(key, known)}")
    missing = [key for key, option in known.items() if option.default is REQUIRED and key not in result]
    if missing:
        raise DeuxError(f"{name} needs a value for {' and '.join(f'{prefix}{key}' for key in missing)}.")
    return result


def _option_value(value: Any, annotation: Any, where: str) -> Any:
    try:
        return _converted(value, annotation, where)
    except _Mismatch:
        names = [member.name for member in annotation] if _is_enum(annotation) else get_args(annotation)
        choices = [choice for choice in names if isinstance(choice, str)]
        if (_is_enum(annotation) or get_origin(annotation) is Literal) and isinstance(value, str) and choices:
            raise DeuxError(f"{where} cannot be {shown(value)}: {near_matches(value, choices)}") from None
        raise DeuxError(f"{where} must be {describe(annotation)}, but is {shown(value)}.") from None


def _converted(value: Any, annotation: Any, where: str) -> Any:
    """The value as the declared type; not checked if no configuration can hold a value of that type."""
    if _is_union(annotation):
        return _first_match(value, alternatives(annotation), where)
    if get_origin(annotation) is Literal:
        return _expect(value, any(value == c and type(value) is type(c) for c in get_args(annotation)))
    if annotation in (None, type(None)):
        return _expect(value, value is None)
    if annotation in (bool, str):
        return _expect(value, isinstance(value, annotation))
    if annotation in (int, float):
        number = isinstance(value, int | float) and not isinstance(value, bool)
        whole = number and (annotation is float or isinstance(value, int) or value.is_integer())
        try:
            return annotation(_expect(value, whole))
        except OverflowError:  # an integer too large for a float
            raise _Mismatch from None
    if annotation is Path:
        return Path(_expect(value, isinstance(value, str | Path)))
    if _is_enum(annotation):
        return _member(value, annotation)
    if _is_mapping(annotation):
        return _mapping(_expect(value, isinstance(value, Mapping)), annotation, where)
    if _is_sequence(annotation):
        return _sequence(_expect(value, isinstance(value, list | tuple)), annotation, where)
    if dataclasses.is_dataclass(annotation) and isinstance(annotation, type):
        if isinstance(value, annotation):
            return value
        return construct(annotation, _expect(value, isinstance(value, Mapping)), where)
    return value


def _expect(value: Any, matches: bool) -> Any:
    if not matches:
        raise _Mismatch
    return value


def _first_match(value: Any, kinds: Sequence[Any], where: str) -> Any:
    """The value as the first type that accepts it; its own type comes first.

    Of int | float, the value's own type matters: Lightning takes 1 for one batch and 1.0 for all of them.
    """
    for kind in sorted(kinds, key=lambda one: one is not type(value)):
        try:
            return _converted(value, kind, where)
        except _Mismatch:
            continue
    raise _Mismatch


def _member(value: Any, kind: type[Enum]) -> Enum:
    """The member with this name, in any case, or else with this value."""
    named = {member.name.lower(): member for member in kind}
    if isinstance(value, str) and not isinstance(value, Enum) and value.lower() in named:
        return named[value.lower()]
    try:
        return kind(value)
    except ValueError:
        raise _Mismatch from None


def _sequence(values: Sequence[Any], annotation: Any, where: str) -> Any:
    arguments = get_args(annotation)
    kind = list if list in (annotation, get_origin(annotation)) else tuple
    if kind is tuple and get_origin(annotation) is tuple and Ellipsis not in arguments:
        _expect(values, len(values) == len(arguments))
        pairs = zip(values, arguments, strict=True)
        return tuple(_converted(v, a, f"{where}[{i}]") for i, (v, a) in enumerate(pairs))
    element = arguments[0] if arguments else Any
    return kind(_converted(value, element, f"{where}[{i}]") for i, value in enumerate(values))


def _mapping(values: Mapping[Any, Any], annotation: Any, where: str) -> dict[str, Any]:
    element = (get_args(annotation) or (Any, Any))[1]
    return {str(key): _converted(value, element, f"{where}.{key}") for key, value in values.items()}


def alternatives(annotation: Any) -> tuple[Any, ...]:
    """The types of a union; for any other type, the type itself."""
    return get_args(annotation) if _is_union(annotation) else (annotation,)


def _is_union(annotation: Any) -> bool:
    return get_origin(annotation) in (Union, types.UnionType)


def _is_enum(annotation: Any) -> bool:
    return isinstance(annotation, type) and issubclass(annotation, Enum)


def _is_sequence(annotation: Any) -> bool:
    return (get_origin(annotation) or annotation) in (tuple, list, Sequence)


def _is_mapping(annotation: Any) -> bool:
    return (get_origin(annotation) or annotation) in (dict, Mapping)


def _json(value: Any) -> Any:
    """The value as JSON can hold it. Raises _Mismatch if its text contains a memory address."""
    if isinstance(value, Enum):
        return value.name
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        value = {field.name: getattr(value, field.name) for field in dataclasses.fields(value)}
    if isinstance(value, Mapping):
        return {str(key): _json(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_json(item) for item in value]
    if isinstance(value, set | frozenset):
        return sorted(
            (_json(item) for item in value), key=repr
        )  # sets of text iterate in another order in each process
    if callable(to_list := getattr(value, "tolist", None)) and not isinstance(value, type):
        return _json(to_list())  # numpy's arrays and scalars; float64 is also a float
    if isinstance(value, bool | int | float | str | None):
        return value
    text = str(value)
    if re.search(r"\bat 0x[0-9a-fA-F]+", text):
        raise _Mismatch
    return text
