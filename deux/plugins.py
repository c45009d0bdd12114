"""Lists the installed plugins (`python -m deux.plugins`), or describes one (`python -m deux.plugins <name>`)."""

from __future__ import annotations

import argparse
import inspect
import os
import sys
from collections.abc import Sequence
from dataclasses import fields, is_dataclass
from difflib import get_close_matches
from enum import Enum
from typing import Any

from rich.console import Console
from rich.table import Table

from deux.errors import DeuxError, near_matches
from deux.options import REQUIRED, Option, describe, is_open_ended, options
from deux.plugin_kinds import GROUPS, KINDS, Plugin
from deux.registry import registry
from deux.search_path import leave_out_working_folder


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command and return its exit code: 0, or 1 for a user's mistake."""
    leave_out_working_folder()
    parser = argparse.ArgumentParser(prog="python -m deux.plugins", description=__doc__)
    parser.add_argument("name", nargs="?", help="a plugin, whose description and options are then printed")
    name = parser.parse_args(arguments).name
    try:
        text = describe_plugin(name) if name else None
    except DeuxError as error:
        print(f"deux: {error}", file=sys.stderr)
        return 1
    try:
        if text is None:
            print_listing()
        else:
            print(text)
        sys.stdout.flush()
    except BrokenPipeError:  # such as from `python -m deux.plugins | head`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # or Python reports it again at exit
    return 0


def listing() -> list[tuple[str, str, str, str, str]]:
    """A row for each installed plugin: kind, name, package, version, and "" or what is wrong with it.

    Entry points of unknown groups, which are probably misspelt, come last, with their group as the kind.
    """
    rows = []
    for kind in KINDS:
        names = [plugin.name for plugin in registry().plugins(kind)]
        for plugin in registry().plugins(kind):
            state = "the name is used twice" if names.count(plugin.name) > 1 else ""
            rows.append((KINDS[kind].noun, plugin.name, plugin.package, plugin.version, state))
    for group, plugins in registry().unknown_groups().items():
        near = get_close_matches(group, GROUPS, n=1, cutoff=0.7)
        state = f"there is no such group{f'; did you mean {near[0]}?' if near else ''}"
        rows += [(group, plugin.name, plugin.package, plugin.version, state) for plugin in plugins]
    return rows


def print_listing() -> None:
    """Print the listing: as a table in a terminal, else as tab-separated lines."""
    columns = ("kind", "name", "package", "version", "state")
    rows = listing()
    if not sys.stdout.isatty():
        print("\n".join("\t".join(row).rstrip() for row in (columns, *rows)))
        return
    table = Table(*columns, title="Installed plugins")
    previous = ""
    for row in rows:
        if previous and row[0] != previous:
            table.add_section()
        table.add_row(*row, style="red" if row[-1] else None)
        previous = row[0]
    Console().print(table)


def describe_plugin(name: str) -> str:
    """Description and options of the plugin `name`; of several, if plugins of several kinds have this name.

    Raises:
        DeuxError: there is no plugin of this name, or it is installed twice or cannot be imported.
    """
    kinds = [kind for kind in KINDS if name in registry().names(kind)]
    if not kinds:
        names = {plugin for kind in KINDS for plugin in registry().names(kind)}
        raise DeuxError(f"there is no plugin called {name!r}: {near_matches(name, names)}")
    return "\n\n".join(_description(registry().find(kind, name)) for kind in kinds)


def _description(plugin: Plugin) -> str:
    kind = KINDS[plugin.kind]
    cls = registry().get(plugin.kind, plugin.name)
    lines = [
        f"{kind.noun} {plugin.name}, from {plugin.origin}",
        "",
        inspect.cleandoc(vars(cls).get("__doc__") or "(no description)"),  # not that of its base class
        "",
    ]
    where = kind.settings.format(name=plugin.name)
    plugin_options = options(cls, kind.given)
    for option in plugin_options.values():
        lines.append(f"  {where}.{option.name}: {describe(option.annotation)}, {_default(option)}")
    if is_open_ended(cls):
        lines.append(f"  {where}.*: any other option, unchecked: a misspelt one is not noticed")
    elif not plugin_options:
        lines.append("It has no options.")
    return "\n".join(lines)


def _default(option: Option) -> str:
    return "required" if option.default is REQUIRED else f"default {_override_value(option.default)}"


def _override_value(value: Any) -> str:
    """A default as on the command line: enum members by name, dataclasses by their options, None as null."""
    if isinstance(value, Enum):
        return value.name
    if is_dataclass(value) and not isinstance(value, type):
        items = (f"{field.name}: {_override_value(getattr(value, field.name))}" for field in fields(value))
        return f"{{{', '.join(items)}}}"
    return "null" if value is None else repr(value)


if __name__ == "__main__":
    sys.exit(main())
