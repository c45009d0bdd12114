"""The error about a plugin that returns something that its contract does not allow.

Checks of tensors on the device look at shapes and types only, since reading their values would wait for it.
"""

from __future__ import annotations

from deux.errors import DeuxError
from deux.registry import registry


def broken_contract(plugin: object | str, gives: str, wanted: str, method: str = "") -> DeuxError:
    """The error to raise if a plugin returns something that its contract does not allow.

    Args:
        plugin: the plugin, named in the message by `Registry.called`; or its name in the message.
        gives: description of what it returned, such as by `deux.errors.kind_of`.
        wanted: description of what it must return.
        method: the method that returned it; "" if the plugin itself was called.
    """
    called = plugin if isinstance(plugin, str) else registry().called(plugin)
    subject = f"the `{method}` of {called}" if method else called
    return DeuxError(f"{subject} gives {gives}: it must be {wanted}.")
