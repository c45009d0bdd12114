"""Hydra's and OmegaConf's errors, said in one sentence of ours."""

from __future__ import annotations

import re

from hydra.errors import MissingConfigException, OverrideParseException
from omegaconf import DictConfig
from omegaconf.errors import ConfigAttributeError, ConfigKeyError

from deux.errors import DeuxError, near_matches

_NOUNS = {
    "model": "depth model",
    "explore": "explorer",
    "scenes": "kind of scenes",
    "callbacks": "callback",
    "experiment": "experiment",
    "scale": "scale",
}
_AMBIGUOUS = re.compile(r"Ambiguous value for argument '(?P<override>.+?)'", re.DOTALL)


def composition_error(error: Exception) -> DeuxError:
    """The user's mistake behind an error raised while a configuration was composed.

    Args:
        error: a `HydraException`, an `OmegaConfBaseException` or a `yaml.YAMLError`.

    Returns:
        The error to raise or print; its sentence names the override or key and what would be right.
    """
    if isinstance(error, MissingConfigException) and error.missing_cfg_file and error.options is not None:
        return _unknown_choice(str(error.missing_cfg_file), list(error.options))
    if isinstance(error, OverrideParseException):
        return _unreadable(error.override)
    if found := _AMBIGUOUS.search(str(error)):
        key, _, values = found["override"].partition("=")
        return DeuxError(f"{key} cannot be {values}: add -m to run each in turn, or write {key}=[{values}] for a list.")
    cause = error.__cause__ or error
    parent = getattr(cause, "parent_node", None)
    if isinstance(cause, ConfigKeyError | ConfigAttributeError) and isinstance(parent, DictConfig):
        return _unknown_option(str(cause.full_key), parent)
    return DeuxError(_first_sentence(error))


def _unknown_choice(missing: str, known: list[str]) -> DeuxError:
    group, _, name = missing.rpartition("/")
    noun = _NOUNS.get(group, f"{group} option" if group else "configuration")
    return DeuxError(f"there is no {noun} called {name!r}: {near_matches(name, known)}")


def _unknown_option(full_key: str, parent: DictConfig) -> DeuxError:
    above, _, key = full_key.rpartition(".")
    if full_key == "callbacks":  # a group that may be left out
        return DeuxError("callbacks has no options before one is chosen: add callbacks=active_collection.")
    if not parent:
        return DeuxError(f"there is no option {full_key}: {above} is a single value.")
    known = [str(name) for name in parent if name != "hydra"]
    return DeuxError(f"there is no option {full_key}: {near_matches(key, known)}")


def _unreadable(override: str) -> DeuxError:
    key, equals, value = override.partition("=")
    if not equals:
        return DeuxError(f"{override!r} is not of the form option=value.")
    return DeuxError(f"the value of {key} needs quotes of its own, as in '{key}=\"{value}\"'.")


def _first_sentence(error: Exception) -> str:
    """The messages of the error and of its cause, on one line, without the lines of advice on Hydra's syntax."""
    lines = [str(e).strip().splitlines()[0] for e in (error, error.__cause__) if e is not None and str(e).strip()]
    return f"the configuration cannot be composed: {'; '.join(lines) or type(error).__name__}"
