"""Plugins with each of their options wrong on purpose: one sentence, or a plugin."""

import functools
from collections.abc import Iterator
from typing import Any

import pytest
from hostile import VALUES, Campaign

from deux.options import options
from deux.plugin_kinds import KINDS
from deux.registry import registry

LARGE = (-0.5, 10**7, 10**20, float("-inf"), " ", "12", "a\udcff", [1, 2])
TINY = {
    "kbnet": {"image_filters": [4] * 5, "depth_filters": [4] * 5, "decoder_filters": [4] * 5},
    "voiced": {"image_filters": [4] * 5, "depth_filters": [4] * 5, "decoder_filters": [4] * 4},
    "scaffnet": {"filters": [4] * 5, "decoder_filters": [4] * 5},
    "fusionnet": {
        **{"image_filters": [4] * 5, "depth_filters": [4] * 5, "decoder_filters": [4] * 5},
        **{"scaffnet_filters": [4] * 5, "scaffnet_decoder_filters": [4] * 5},
    },
}
"""Options with which a model is made in no time."""


def wrong_values(default: Any) -> Iterator[Any]:
    """Values of any type; of a list also one that is shorter, longer, reversed, or of other numbers."""
    yield from (*VALUES, *LARGE)
    if isinstance(default, tuple | list) and default:
        yield from ([number] * len(default) for number in (0, -1, 0.5, 10**7, 10**20, float("nan")))
        yield from (list(default)[:-1], [*default, default[-1]], list(default)[::-1])
    if isinstance(default, dict):
        yield from ({**default, key: value} for key in default for value in (*VALUES, *LARGE))


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("kind", [name for name, kind in KINDS.items() if not kind.given])
def test_options_of_plugins(campaign: Campaign, kind: str) -> None:
    names = registry().names(kind)
    registry().create(kind, names[0], {})  # what it imports is not charged to the first case
    for name in names:
        for option in options(registry().get(kind, name)).values():
            for value in wrong_values(option.default):
                settings = {**TINY.get(name, {}), option.name: value}
                make = functools.partial(registry().create, kind, name, settings)
                campaign.call(f"{name}.{option.name}={value!r:.40}", make)
    campaign.end()
