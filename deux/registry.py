"""The plugin registry: installed plugins are found by entry points and imported one at a time.

A package declares a plugin in its `pyproject.toml`:

    [project.entry-points."deux.explorers"]
    spiral = "my_package.spiral:SpiralExplorer"

Listing plugins imports nothing. A plugin is imported when it is chosen, so start-up stays fast and a broken package
affects only those who choose its plugins.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib.metadata import EntryPoint, EntryPoints, entry_points
from typing import Any

from deux.contract_checks import check_class, check_instance, module_initialised
from deux.errors import DeuxError, near_matches
from deux.options import construct, full_settings
from deux.plain_settings import plain
from deux.plugin_kinds import GROUPS, KINDS, Plugin

OWN_PACKAGE = "deux"
"""The distribution that contains the framework and the plugins that ship with it."""


@dataclass(frozen=True)
class PluginChoice:
    """A plugin's name and all its options, which can be sent to other processes.

    Args:
        kind: a key of `KINDS`.
        name: its registered name.
        settings: every option, defaults included, as JSON values for hashes and records.
        defaulted: names of the options left at their defaults.
    """

    kind: str
    name: str
    settings: Mapping[str, Any]
    defaulted: frozenset[str] = field(default=frozenset(), compare=False)

    def create(self, *given: Any) -> Any:
        """Create the plugin, a new instance at each call; `given` as in `Registry.create`.

        Options left at their defaults are not passed on, since the constructor's defaults need not be JSON values.
        """
        return registry().create(self.kind, self.name, self.chosen, *given)

    @property
    def chosen(self) -> dict[str, Any]:
        """The options that were set explicitly."""
        return {name: value for name, value in self.settings.items() if name not in self.defaulted}

    @property
    def description(self) -> dict[str, Any]:
        """Name and options in one dictionary, for hashes and records."""
        return {"name": self.name, **self.settings}


class Registry:
    """All plugins of one process: installed ones and those registered by hand."""

    def __init__(self) -> None:
        self._plugins: dict[str, list[Plugin]] = {}
        self._classes: dict[type, Plugin] = {}

    @functools.cached_property
    def _installed(self) -> Any:
        """The entry points of all groups, cached because scanning the installed packages takes some 20 ms."""
        return entry_points()

    def entry_points(self, group: str) -> EntryPoints:
        """The entry points of a group, as they were at the first call."""
        found: EntryPoints = self._installed.select(group=group)
        return found

    def unknown_groups(self) -> dict[str, list[Plugin]]:
        """Entry points in groups called "deux.*" that are not in `GROUPS`, by group: probably misspelt kinds."""
        unknown = sorted(group for group in self._installed.groups if group.startswith("deux.") and group not in GROUPS)
        return {group: [_from_entry_point(group, entry) for entry in self.entry_points(group)] for group in unknown}

    def plugins(self, kind: str) -> list[Plugin]:
        """All plugins of a kind, sorted by name; if two packages use one name, both are listed."""
        return sorted(self._table(kind), key=lambda plugin: (plugin.name, plugin.package))

    def names(self, kind: str) -> list[str]:
        """The names of a kind's plugins, sorted, each once."""
        return sorted({plugin.name for plugin in self._table(kind)})

    def find(self, kind: str, name: str) -> Plugin:
        """The plugin of that name, without importing it.

        Raises:
            DeuxError: no plugin of that kind has the name, or several do.
        """
        found = self._named(kind, name)
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
        """Raise DeuxError if no plugin of that kind has the name; several may have it."""
        self._named(kind, name)

    def get(self, kind: str, name: str) -> type:
        """Import the plugin of that name and return its class.

        Raises:
            DeuxError: as `find`; or the plugin cannot be imported, is no subclass of its kind's contract, or lacks a
                method of the contract.
        """
        plugin = self.find(kind, name)
        noun = KINDS[kind].noun
        try:
            cls = plugin.load()
        except Exception as error:  # importing a third-party module may raise anything
            cause = " ".join(f"{type(error).__name__}: {error}".split()).rstrip(".")
            raise DeuxError(f"the {noun} {name!r} of {plugin.origin} cannot be imported: {cause}.") from error
        check_class(plugin, cls)
        self._classes[cls] = plugin
        return cls

    def called(self, instance: object) -> str:
        """How error messages name an instance: by `Plugin.called`, or by its class if it was not created here."""
        if plugin := self._classes.get(type(instance)):
            return plugin.called
        contracts = {cls.__name__ for cls in type(instance).__mro__ if cls.__module__.startswith("deux.contracts.")}
        noun = next((f"the {kind.noun} " for kind in KINDS.values() if kind.contract in contracts), "")
        return f"{noun}{type(instance).__name__}"

    def create(self, kind: str, name: str, settings: Mapping[str, Any], *given: Any) -> Any:
        """Create the plugin of that name from its options; an entry "name" among them is ignored.

        Args:
            kind: a key of `KINDS`.
            name: the plugin's name.
            settings: its options.
            given: arguments for the parameters in the kind's `given`, in that order.

        Raises:
            DeuxError: as `get` and `deux.options.construct`; or the instance violates its contract
                (`deux.contract_checks`).
        """
        cls = self.get(kind, name)
        chosen = {key: value for key, value in settings.items() if key != "name"}
        filled = dict(zip(KINDS[kind].given, given, strict=True))
        plugin = self.find(kind, name)
        with module_initialised(plugin):
            instance = construct(cls, chosen, KINDS[kind].settings.format(name=name), filled)
        check_instance(plugin, instance)
        return instance

    def choose(self, kind: str, chosen: Any, where: str = "") -> PluginChoice:
        """A plugin with all its options, defaults filled in; it is imported but not created.

        Args:
            kind: a key of `KINDS`.
            chosen: its "name" and the options that differ from their defaults; the kind's reserved ones are ignored.
            where: their path in the configuration, which error messages begin with; by default that of the kind.

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
        """Add a plugin for this process only, such as in tests and notebooks.

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
        """Remove a plugin, for this process only, and return it. Raises DeuxError as `find` does."""
        plugin = self.find(kind, name)
        self._table(kind).remove(plugin)
        return plugin

    def _named(self, kind: str, name: str) -> list[Plugin]:
        """The plugins of that name. Raises DeuxError if there is none."""
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
    """The registry of this process, created at the first call."""
    return Registry()


def _from_entry_point(kind: str, entry: EntryPoint) -> Plugin:
    package = entry.dist.name if entry.dist else "an unknown package"
    version = entry.dist.version if entry.dist else "?"
    return Plugin(entry.name, kind, package, version, entry.value, entry.load)
