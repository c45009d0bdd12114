"""Conversion of configurations of earlier versions to the current keys, so that reports can read their runs."""

from collections.abc import Mapping
from typing import Any

RENAMED_OPTIONS = {"random_seed": "seed"}
"""Options that sweeps of version 0.1.0 may have varied, with their current names."""

_RENAMED_IN = {"scenes": {"source": "name"}, "foundation": {"flats": "scenes"}}
"""Renamed keys, by section."""


def current_keys(configuration: Mapping[str, Any]) -> dict[str, Any]:
    """Convert a run's configuration to the current keys, as far as they affect results.

    Version 0.1.0, recognised by `random_seed`, had `random_seed` for `seed`, `seed` for `seed_model`, `renderer` for
    `simulator`, `scenes.source` for `scenes.name`, `foundation.flats` for `foundation.scenes`, and in `callbacks` the
    options of its only callback, and deux had sampled targets only. The option `max_range` of deux was null by default,
    which meant 3 m for predicted depth and 5 m for the sensor's.

    Args:
        configuration: the content of `run.json` or Hydra's `config.yaml`, of any version.
    """
    converted = dict(configuration)
    explore = dict(converted.get("explore") or {})
    if explore.get("name") == "deux":
        if "max_range" in explore and explore["max_range"] is None:
            explore["max_range"] = 5.0 if explore.get("map_depth") == "sensor" else 3.0
        if "random_seed" in converted:
            explore.setdefault("target", "sampled")
        converted["explore"] = explore
    if "random_seed" not in converted:
        return converted
    if "seed" in converted:
        converted["seed_model"] = converted["seed"]
    converted["seed"] = converted.pop("random_seed")
    if "renderer" in converted:
        converted["simulator"] = {"name": "mesh", "renderer": converted.pop("renderer")}
    for section, renamed in _RENAMED_IN.items():
        if isinstance(converted.get(section), Mapping):
            converted[section] = {renamed.get(key, key): value for key, value in converted[section].items()}
    if converted.get("callbacks"):
        converted["callbacks"] = {"active_collection": converted["callbacks"]}
    converted.setdefault("data", {"name": "deux"})
    return converted
