"""The plugins that are installed, found by their packages' entry points and loaded one at a time.

A package declares a plugin in its `pyproject.toml`:

    [project.entry-points."deux.explorers"]
    spiral = "my_package.spiral:SpiralExplorer"

Reading the tables imports nothing. An entry is imported when it is chosen, so start-up stays fast and a package that
is broken harms nobody who does not ask for it.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib.metadata import EntryPoint, EntryPoints, entry_points
from typing import Any

from deux.contract_checks import check_class, check_made, module_begun
from deux.errors import DeuxError, near_matches
from deux.options import construct, full_settings
from deux.plain_settings import plain
from deux.plugin_kinds import GROUPS, KINDS, Plugin

OWN_PACKAGE = "deux"
"""The distribution that the framework and the plugins that ship with it come in."""


@dataclass(frozen=True)
class PluginChoice:
    """A plugin and all its options; it travels to other processes.

    Args:
        kind: a key of `KINDS`.
        name: its registered name.
        settings: every option, defaults included; JSON values, for hashes and records.
        defaulted: names of the options that nobody chose.
    """

    kind: str
    name: str
    settings: Mapping[str, Any]
    defaulted: frozenset[str] = field(default=frozenset(), compare=False)

    def create(self, *given: Any) -> Any:
        """Make the plugin, anew at each call; `given` as in `Registry.create`.

        What nobody chose is left to its constructor, whose defaults may be no JSON values.
        """
        return registry().create(self.kind, self.name, self.chosen, *given)

    @property
    def chosen(self) -> dict[str, Any]:
        """The options that were chosen, without those that are left to their defaults."""
        return {name: value for name, value in self.settings.items() if name not in self.defaulted}

    @property
    def description(self) -> dict[str, Any]:
        """Name and options in one dictionary, for hashes and records."""
        return {"name": self.name, **self.settings}


class Registry:
    """All plugins of one process: the installed ones and those registered by hand."""

    def __init__(self) -> None:
        self._plugins: dict[str, list[Plugin]] = {}
        self._classes: dict[type, Plugin] = {}

    @functools.cached_property
    def _installed(self) -> Any:
        """What the installed packages declare, of all groups: going through them takes some 20 ms each time."""
        return entry_points()

    def entry_points(self, group: str) -> EntryPoints:
        """What the packages that were installed at the first call declare of a group."""
        found: EntryPoints = self._installed.select(group=group)
        return found

    def unknown_groups(self) -> dict[str, list[Plugin]]:
        """What packages declare in groups whose names begin with "deux." and which are none of `GROUPS`, by group."""
        unknown = sorted(group for group in self._installed.groups if group.startswith("deux.") and group not in GROUPS)
        return {group: [_from_entry_point(group, entry) for entry in self.entry_points(group)] for group in unknown}

    def plugins(self, kind: str) -> list[Plugin]:
        """All plugins of a kind, sorted by name; where two packages use one name, both are listed."""
        return sorted(self._table(kind), key=lambda plugin: (plugin.name, plugin.package))

    def names(self, kind: str) -> list[str]:
        """The names of a kind's plugins, sorted, each once."""
        return sorted({plugin.name for plugin in self._table(kind)})

    def find(self, kind: str, name: str) -> Plugin:
        """The one plugin of that name, not yet imported.

        Raises:
            DeuxError: nothing of that kind has the name, or two packages have it.
        """
        found = self._called(kind, name)
        if len(found) > 1:
            owners = " and ".join(plugin.origin for plugin in found)
            others = [plugin.package for plugin in found if plugin.package != OWN_PACKAGE]
            advice = "uninstall all but one"
            if len(others) < len(found):
                packages = " and ".join(dict.fromkeys(others))
                advice = f"give that of {packages} another name, or uninstall {packages}"
            raise DeuxError(f"the name {name!r} belongs to {len(found)} {KINDS[kind].noun}s, of {owners}: {advice}.")
        return found[0]

    def check_name(self, kind: str, name: str) -> None:
        """Raise DeuxError if nothing of that kind has the name; two packages may have it."""
        self._called(kind, name)

    def get(self, kind: str, name: str) -> type:
        """Import the plugin of that name and return its class.

        Raises:
            DeuxError: as `find`; or the plugin cannot be imported, does not derive from its kind's contract, or leaves
                a method of the contract undefined.
        """
        plugin = self.find(kind, name)
        noun = KINDS[kind].noun
        try:
            cls = plugin.load()
        except Exception as error:  # a foreign module may raise anything while it is imported
            cause = " ".join(f"{type(error).__name__}: {error}".split()).rstrip(".")
            raise DeuxError(f"the {noun} {name!r} of {plugin.origin} cannot be imported: {cause}.") from error
        check_class(plugin, cls)
        self._classes[cls] = plugin
        return cls

    def called(self, made: object) -> str:
        """How messages call a plugin that was made: as `Plugin.called`, or by its class where it was made by hand."""
        if plugin := self._classes.get(type(made)):
            return plugin.called
        contracts = {cls.__name__ for cls in type(made).__mro__ if cls.__module__.startswith("deux.contracts.")}
        noun = next((f"the {kind.noun} " for kind in KINDS.values() if kind.contract in contracts), "")
        return f"{noun}{type(made).__name__}"

    def create(self, kind: str, name: str, settings: Mapping[str, Any], *given: Any) -> Any:
        """Make the plugin of that name from its options; an entry "name" among them is left out.

        Args:
            kind: a key of `KINDS`.
            name: the plugin's name.
            settings: its options.
            given: values of the parameters that the kind's `given` names, in that order.

        Raises:
            DeuxError: as `get` and `deux.options.construct`; or the plugin lacks an attribute of the contract, or
                declares its needs as something else than a frozenset of them; or it is a torch module whose
                constructor does not begin with that of its base class.
        """
        cls = self.get(kind, name)
        chosen = {key: value for key, value in settings.items() if key != "name"}
        filled = dict(zip(KINDS[kind].given, given, strict=True))
        plugin = self.find(kind, name)
        with module_begun(plugin):
            made = construct(cls, chosen, KINDS[kind].settings.format(name=name), filled)
        check_made(plugin, made)
        return made

    def choose(self, kind: str, chosen: Any, where: str = "") -> PluginChoice:
        """A plugin with all its options, defaults filled in; it is imported and not made.

        Args:
            kind: a key of `KINDS`.
            chosen: its "name" and the options that are not left at their defaults; reserved ones are left out.
            where: their place in the configuration, which begins every message; by default that of the kind.

        Raises:
            DeuxError: there is no name, no such plugin, or an option that it does not have.
        """
        where = where or KINDS[kind].settings
        settings = plain(chosen, where)
        name = settings.pop("name", None)
        for option in KINDS[kind].reserved:
            settings.pop(option, None)
        if name is None:
            raise DeuxError(f"{where}.name is missing: choose one with {where}=<name>.")
        full = full_settings(self.get(kind, name), settings, where, KINDS[kind].given)
        return PluginChoice(kind, name, full, frozenset(full.keys() - settings.keys()))

    def register(self, kind: str, name: str, cls: type) -> Plugin:
        """Add a plugin by hand, for this process only: for tests and notebooks.

        Raises:
            DeuxError: the name is taken, or `cls` does not fulfil the contract.
        """
        taken = [plugin for plugin in self._table(kind) if plugin.name == name]
        if taken:
            raise DeuxError(f"the {KINDS[kind].noun} {name!r} is there already, from {taken[0].origin}.")
        target = f"{cls.__module__}:{cls.__qualname__}"
        plugin = Plugin(name, kind, "registered by hand", "-", target, lambda: cls)
        check_class(plugin, cls)
        self._table(kind).append(plugin)
        return plugin

    def unregister(self, kind: str, name: str) -> Plugin:
        """Take a plugin out, for this process only, and return it. Raises DeuxError as `find` does."""
        plugin = self.find(kind, name)
        self._table(kind).remove(plugin)
        return plugin

    def _called(self, kind: str, name: str) -> list[Plugin]:
        found = [plugin for plugin in self.plugins(kind) if plugin.name == name]
        if not found:
            raise DeuxError(f"there is no {KINDS[kind].noun} called {name!r}: {near_matches(name, self.names(kind))}")
        return found

    def _table(self, kind: str) -> list[Plugin]:
        if kind not in KINDS:
            raise DeuxError(f"{kind!r} is not a kind of plugin: {near_matches(kind, KINDS)}")
        if kind not in self._plugins:
            self._plugins[kind] = [_from_entry_point(kind, e) for e in self.entry_points(KINDS[kind].group)]
        return self._plugins[kind]


@functools.cache
def registry() -> Registry:
    """The registry of this process, made at the first call."""
    return Registry()


def _from_entry_point(kind: str, entry: EntryPoint) -> Plugin:
    package = entry.dist.name if entry.dist else "an unknown package"
    version = entry.dist.version if entry.dist else "?"
    return Plugin(entry.name, kind, package, version, entry.value, entry.load)
