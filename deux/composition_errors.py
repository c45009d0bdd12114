"""Error messages about wrong overrides on the command line: translation of Hydra's errors, and additional checks."""

from __future__ import annotations

import re
import sys
import traceback
from collections.abc import Iterable

from hydra.errors import HydraException, MissingConfigException, OverrideParseException
from omegaconf import DictConfig
from omegaconf.errors import ConfigAttributeError, ConfigKeyError, InterpolationKeyError, OmegaConfBaseException
from yaml import YAMLError

from deux.callbacks import callback_names
from deux.errors import DeuxError, near_matches
from deux.plain_settings import unresolved_reference

RENAMED = {
    "random_seed": "seed",
    "seed.checkpoint": "seed_model.checkpoint",
    "seed.explore": "seed_model.explore",
    "seed.steps": "seed_model.steps",
    "renderer": "simulator.renderer",
    "checkpoint": "predict.checkpoint, or with task=export export.checkpoint",
    "image": "predict.image",
    "sparse": "predict.sparse",
    "sparse_scale": "predict.sparse_scale",
    "intrinsics": "predict.intrinsics",
    "ground_truth": "predict.ground_truth",
    "scenes.source": "scenes.name",
    "foundation.flats": "foundation.scenes",
    "explorer_training.flats": "explorer_training.scenes",
    "collect.together": "collect.batch_size",
    "compare.flats": "scenes.test",
    **{f"callbacks.{option}": f"callbacks.active_collection.{option}" for option in
       ("every", "unit", "rounds", "steps", "episodes", "mode")},
}  # fmt: skip
"""Options of earlier versions, with their current names."""

_NOUNS = {
    "model": "depth model",
    "explore": "explorer",
    "scenes": "source of scenes",
    "data": "reader",
    "callbacks": "callback",
}
"""Nouns for the choices of config groups; those of other groups are called by the group's name."""

_TEXT = ("paths.outputs", "hydra.run.dir", "hydra.sweep.dir", "training_data")
"""Options that are file names, even if they look like numbers."""

_LAUNCHER_EXTRAS = {
    "joblib": "joblib",
    "submitit_local": "slurm",
    "submitit_slurm": "slurm",
    "ray": "ray_launcher",
}
"""The extra that installs a launcher of sweeps, by the launcher's name (docs/sweeps.md)."""

_GROUPS = (*_NOUNS, "simulator", "scale", "report", "experiment")
"""Options whose values are names of files or plugins, which are never numbers."""

_LIBRARIES = ("hydra", "omegaconf", "yaml", "antlr4")
"""Packages that compose a configuration; they raise errors of many types for invalid values."""

_NO_OPTION = re.compile(r"Could not load '(?P<group>[^'/]+)/(?P<name>[^']+)'")
_AMBIGUOUS = re.compile(r"Ambiguous value for argument '(?P<override>.+?)'", re.DOTALL)
_PRESENT = re.compile(r"An item is already at '(?P<key>.+?)'")
_KEY = re.compile(r"[+~]*(?P<key>[^=@]+)")
_GROUPED_DIGITS = re.compile(r"\d{1,3}(_\d{3})+")
_DIGITS = re.compile(r"\d[\d_]*_[\d_]*")
_NUMBER = re.compile(r"[+-]?((\d[\d_]*\.?\d*|\.\d+)(e[+-]?\d+)?|\.?inf|\.?nan)|true|false|null", re.IGNORECASE)
_LIST_IN_QUOTES = re.compile(r"""(?P<quote>["'])\[(?P<items>.*)\](?P=quote)""", re.DOTALL)


def check_names(overrides: Iterable[str]) -> None:
    """Raise DeuxError for an override with a name of an earlier version, or with a value that Hydra would misread.

    Args:
        overrides: overrides of the command line, such as "model=kbnet".
    """
    for override in overrides:
        match = _KEY.match(override)
        key, _, value = override.partition("=")
        name = match["key"] if match else key
        if name in RENAMED:
            raise DeuxError(f"there is no option {name}: it is now called {RENAMED[name]}.")
        if name == "callbacks" and value == "none":
            raise DeuxError("callbacks=none is now callbacks=[], a list of callbacks without any.")
        if name in _GROUPS and name != "callbacks" and re.match(r"\+(?!\+)", override):
            raise _added_again(name)
        if name in _GROUPS and _NUMBER.fullmatch(value) and value.lower() != "null":
            raise DeuxError(f"{name} is chosen by a name, but {value} is not a name.")
        if quoted := _LIST_IN_QUOTES.fullmatch(value):
            raise DeuxError(
                f"the quotes around the whole list make {name} a single text: {_quote(key, quoted['items'])}."
            )
        if name in _TEXT and _NUMBER.fullmatch(value) and not _DIGITS.fullmatch(value):
            raise DeuxError(f"{name} must be text, but {value} would not be read as text: write '{key}=\"{value}\"'.")


def quoted_digits(argument: str) -> str:
    """Quote the value of an override that Hydra would read as a number, although it is not written like one.

    Example:
        >>> quoted_digits("paths.outputs=2024_01_15"), quoted_digits("training.steps=10_000")
        ("paths.outputs='2024_01_15'", 'training.steps=10_000')
    """
    key, _, value = argument.partition("=")
    if _DIGITS.fullmatch(value) and not _GROUPED_DIGITS.fullmatch(value):
        return f"{key}='{value}'"
    return argument


def raised_in_composition(error: BaseException) -> bool:
    """Whether an error of any type was raised by the packages that compose a configuration.

    Errors raised by plugins or deux itself do not count, unless OmegaConf wraps them.
    """
    if isinstance(error, HydraException | OmegaConfBaseException | YAMLError):
        return True
    modules = (frame.f_globals.get("__name__", "") for frame, _ in traceback.walk_tb(error.__traceback__))
    packages = [root for module in modules if (root := module.partition(".")[0]) not in sys.stdlib_module_names]
    return bool(packages) and packages[-1] in _LIBRARIES


def composition_error(error: Exception) -> DeuxError:
    """The user's mistake behind an error raised while a configuration was composed.

    Args:
        error: an error for which `raised_in_composition` is true.

    Returns:
        The error to raise or print; its message contains the override or key and what would be right.
    """
    if mistake := _wrapped_mistake(error):
        return mistake
    if isinstance(error, MissingConfigException) and error.missing_cfg_file and error.options is not None:
        return _unknown_choice(str(error.missing_cfg_file), list(error.options))
    if match := _NO_OPTION.search(str(error)):
        # callbacks is the only group that is a list
        return _unknown_choice(f"{match['group']}/{match['name']}", callback_names())
    if isinstance(error, OverrideParseException):
        return _unreadable(error.override)
    if match := _AMBIGUOUS.search(str(error)):
        key, _, values = match["override"].partition("=")
        return DeuxError(f"{key} cannot be {values}: add -m to run each in turn, or write {key}=[{values}] for a list.")
    if match := _PRESENT.search(str(error)):
        return _added_again(match["key"])
    cause = error.__cause__ or error
    if isinstance(cause, InterpolationKeyError):
        return DeuxError(unresolved_reference(cause))
    parent = getattr(cause, "parent_node", None)
    if isinstance(cause, ConfigKeyError | ConfigAttributeError) and isinstance(parent, DictConfig):
        return _unknown_option(str(cause.full_key), parent)
    return DeuxError(_first_sentence(error))


def _wrapped_mistake(error: BaseException | None) -> DeuxError | None:
    """The DeuxError that one of deux's resolvers raised and OmegaConf wrapped, or None."""
    while error is not None and not isinstance(error, DeuxError):
        error = error.__cause__ or error.__context__
    return error


def _unknown_choice(missing: str, known: list[str]) -> DeuxError:
    group, _, name = missing.rpartition("/")
    if group == "hydra/launcher" and name in _LAUNCHER_EXTRAS:
        return DeuxError(f"{group}={name} is not installed: pip install 'deux[{_LAUNCHER_EXTRAS[name]}]'.")
    noun = _NOUNS.get(group, group or "configuration")
    return DeuxError(f"there is no {noun} called {name!r}: {near_matches(name, known)}")


def _added_again(key: str) -> DeuxError:
    return DeuxError(f"+{key}= adds an option, but {key} exists: write {key}=, without the plus sign.")


def _unknown_option(full_key: str, parent: DictConfig) -> DeuxError:
    above, _, key = full_key.rpartition(".")
    if full_key in RENAMED:
        return DeuxError(f"there is no option {full_key}: it is now called {RENAMED[full_key]}.")
    if not parent:
        return DeuxError(f"there is no option {full_key}: {above} is a single value.")
    if above == "hydra.launcher" and "BasicLauncher" in str(parent.get("_target_")):
        return DeuxError(
            f"there is no option {full_key}: the launcher basic has no options; choose another one, such as with "
            "hydra/launcher=joblib."
        )
    names = [str(name) for name in parent if name != "hydra"]
    return DeuxError(f"there is no option {full_key}: {near_matches(key, names)}")


def _unreadable(override: str) -> DeuxError:
    key, equals, value = override.partition("=")
    if not equals:
        return DeuxError(f"{override!r} is not of the form option=value.")
    if value.startswith("[") and value.endswith("]"):
        return DeuxError(f"the items of {key} need quotes of their own: {_quote(key, value[1:-1])}.")
    if value.endswith(","):
        return DeuxError(f"the value of {key} ends with a comma: write several values without spaces, {key}={value}...")
    return DeuxError(f"the value of {key} needs quotes of its own, as in '{key}=\"{value}\"'.")


def _quote(key: str, items: str) -> str:
    """Advice on writing a list whose items need quotes, as the end of a sentence."""
    quoted = ",".join(f'"{item.strip()}"' for item in items.split(","))
    return f"write '{key}=[{quoted}]'"


def _first_sentence(error: Exception) -> str:
    """The first lines of the messages of an error and its cause, without Hydra's advice on syntax."""
    lines = [str(e).strip().splitlines()[0] for e in (error, error.__cause__) if e is not None and str(e).strip()]
    return f"the configuration cannot be composed: {'; '.join(lines) or type(error).__name__}"
