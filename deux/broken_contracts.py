"""The sentence about a plugin that gives something else than its contract says, which all checks of that share.

Such a check looks at shapes and types alone where values lie on a device, so that nobody waits for it.
"""

from __future__ import annotations

from deux.errors import DeuxError
from deux.registry import registry


def broken_contract(plugin: object | str, gives: str, wanted: str, method: str = "") -> DeuxError:
    """The error to be raised where a plugin gives what its contract does not allow.

    Args:
        plugin: the plugin, which the message calls as `Registry.called` does; or how it is called.
        gives: what it gives, such as `deux.errors.kind_of` says it, and for what.
        wanted: what would be right.
        method: what of the plugin gives it; left out where a plugin is called itself.
    """
    called = plugin if isinstance(plugin, str) else registry().called(plugin)
    subject = f"the `{method}` of {called}" if method else called
    return DeuxError(f"{subject} gives {gives}: it must be {wanted}.")
