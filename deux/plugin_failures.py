"""Messages about unexpected errors of plugins."""

from __future__ import annotations

import traceback

from deux.errors import DeuxError, printable
from deux.plugin_kinds import KINDS
from deux.registry import OWN_PACKAGE, registry


def creation_failure(name: str, error: BaseException) -> str:
    """The message about a plugin that cannot be created: that of a DeuxError, or one with the error's type."""
    if isinstance(error, DeuxError):
        return str(error)
    return f"{name} cannot be created: {type(error).__name__}: {printable(str(error))}."


def raised_in(error: BaseException) -> str | None:
    """The third-party plugin package whose code is innermost in an error's stack trace, or None.

    Args:
        error: the error as caught, with its stack trace.

    Returns:
        The package, its version, and the file and line of its innermost frame.
    """
    plugins = (plugin for kind in KINDS for plugin in registry().plugins(kind) if plugin.package != OWN_PACKAGE)
    packages = {plugin.target.partition(":")[0].partition(".")[0]: plugin for plugin in plugins}
    found = None
    for frame, line in traceback.walk_tb(error.__traceback__):
        module = frame.f_globals.get("__name__") or ""
        if plugin := packages.get(module.partition(".")[0]):
            found = f"{plugin.package} {plugin.version}, in {frame.f_code.co_filename}, line {line}"
    return found
