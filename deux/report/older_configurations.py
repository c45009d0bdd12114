"""The configuration of a run of version 0.1.0 in today's keys, so that its results stay readable."""

from collections.abc import Mapping
from typing import Any

RENAMED_OPTIONS = {"random_seed": "seed"}
"""Options that a sweep of version 0.1.0 may have been over, and today's names for them."""

_RENAMED_IN = {"scenes": {"source": "name"}, "foundation": {"flats": "scenes"}}
"""Sections of which keys have changed their names."""


def current_keys(configuration: Mapping[str, Any]) -> dict[str, Any]:
    """A run's configuration in today's keys, as far as they say what its results depend on.

    Version 0.1.0, which is told by its `random_seed`, had `random_seed` for `seed`, `seed` for `seed_model`, `renderer`
    for `simulator`, `scenes.source` for `scenes.name`, `foundation.flats` for `foundation.scenes`, and in `callbacks`
    the options of the one callback that there was.

    Args:
        configuration: as `run.json` or Hydra's `config.yaml` holds it, of any version.
    """
    found = dict(configuration)
    if "random_seed" not in found:
        return found
    if "seed" in found:
        found["seed_model"] = found["seed"]
    found["seed"] = found.pop("random_seed")
    if "renderer" in found:
        found["simulator"] = {"name": "mesh", "renderer": found.pop("renderer")}
    for section, renamed in _RENAMED_IN.items():
        if isinstance(found.get(section), Mapping):
            found[section] = {renamed.get(key, key): value for key, value in found[section].items()}
    if found.get("callbacks"):
        found["callbacks"] = {"active_collection": found["callbacks"]}
    found.setdefault("data", {"name": "deux"})
    return found
