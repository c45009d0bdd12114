"""Training callbacks by name: those of Lightning that can be configured by the options of their constructor.

Their names are listed here, so that the command line can check them without importing Lightning, which is slow. Left
out are callbacks that need objects, that search settings instead of training (learning_rate_finder, batch_size_finder),
that change the names of weights (model_pruning), that set the learning rate (stochastic_weight_averaging) or that
duplicate `deux.training.fit` (progress bars, on_exception_checkpoint).
"""

from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeVar, get_args, get_origin

from deux.errors import DeuxError, near_matches, shown
from deux.options import alternatives, construct, converted, describe, options

if TYPE_CHECKING:
    from lightning.pytorch import Callback

T = TypeVar("T")

ACTIVE_COLLECTION = "active_collection"
"""Name of `deux.training.active_collection.ActiveCollection`, which tasks create themselves."""

_LIGHTNING: dict[str, str] = {
    "device_stats_monitor": "DeviceStatsMonitor",
    "early_stopping": "EarlyStopping",
    "ema_weight_averaging": "EMAWeightAveraging",
    "learning_rate_monitor": "LearningRateMonitor",
    "model_checkpoint": "ModelCheckpoint",
    "model_summary": "ModelSummary",
    "rich_model_summary": "RichModelSummary",
    "throughput_monitor": "ThroughputMonitor",
    "timer": "Timer",
    "weight_averaging": "WeightAveraging",
}

CALLBACKS: dict[str, str] = {name: f"lightning.pytorch.callbacks:{cls}" for name, cls in _LIGHTNING.items()}
"""The class of each callback, as "module:Class"."""

_GIVEN: dict[str, dict[str, Any]] = {"throughput_monitor": {"batch_size_fn": lambda batch: len(batch.image)}}
"""Arguments that cannot be options, such as functions."""

_PACKAGES = {"device_stats_monitor": "psutil"}
"""Packages that a callback imports in the middle of a run, and that deux does not install."""


def callback_names() -> list[str]:
    """The names of all callbacks, sorted."""
    return sorted([*CALLBACKS, ACTIVE_COLLECTION])


def make_callback(name: str, settings: Mapping[str, Any]) -> "Callback":
    """Create a callback by name, except `active_collection`.

    Args:
        name: one of `CALLBACKS`.
        settings: options of its constructor.

    Raises:
        DeuxError: the name is unknown, an option is unknown or missing, a value is invalid, or a package is missing.
    """
    if name not in CALLBACKS:
        raise DeuxError(f"there is no callback called {name!r}: {near_matches(name, callback_names())}")
    package = _PACKAGES.get(name)
    if package is not None and find_spec(package) is None:
        raise DeuxError(f"callbacks.{name} needs the package {package}: install it with pip install {package}.")
    module, _, attribute = CALLBACKS[name].partition(":")
    target: Callable[..., Callback] = getattr(import_module(module), attribute)
    return lightning_object(target, settings, f"callbacks.{name}", _GIVEN.get(name))


def check_monitor(name: str, callback: "Callback", quantities: Sequence[str]) -> None:
    """Check the quantity that a callback monitors; Lightning would only do so in the middle of the training.

    Args:
        name: name of the callback.
        callback: the callback.
        quantities: quantities that the training logs.

    Raises:
        DeuxError: the callback monitors a quantity that is not logged.
    """
    monitor = getattr(callback, "monitor", None)
    logged = [*quantities, *(("epoch", "step") if name == "model_checkpoint" else ())]
    if monitor is not None and monitor not in logged and getattr(callback, "strict", True):
        validates = any(quantity.startswith("validation/") for quantity in logged)
        raise DeuxError(
            f"callbacks.{name}.monitor={monitor} is not logged by this training"
            f"{'' if validates else ', which has no validation frames'}: {near_matches(monitor, logged)}"
        )


def lightning_object(
    target: Callable[..., T], settings: Mapping[str, Any], where: str, given: Mapping[str, Any] | None = None
) -> T:
    """Like `deux.options.construct`, for a class of Lightning, whose errors are turned into a DeuxError.

    Args:
        target: the class.
        settings: values of options by name.
        where: path of the settings in the configuration, such as "trainer".
        given: arguments that are not options.

    Raises:
        DeuxError: an option is unknown or missing, or its value is invalid.
    """
    _check_values(target, settings, where)
    try:
        return construct(target, settings, where, given)
    except DeuxError:
        raise
    except Exception as error:  # Lightning checks few arguments; the others raise errors of many types
        cause = " ".join(str(error).split()).rstrip(".!")
        name = getattr(target, "__name__", str(target))
        raise DeuxError(f"lightning.{name} refuses the settings under {where}: {cause}.") from error


def _check_values(target: Callable[..., Any], settings: Mapping[str, Any], where: str) -> None:
    """Raise DeuxError for plain values of parameters that take objects, which would fail at their first use."""
    for name, option in options(target).items():
        value = settings.get(name)
        if value is None or not _is_plain(value):
            continue
        kinds = [kind for kind in alternatives(option.annotation) if _is_holdable(kind)]
        if not any(_fits(value, kind) for kind in kinds):
            words = " or ".join(map(describe, kinds)) or "left out"
            raise DeuxError(
                f"{where}.{name} must be {words}, but is {shown(value)}: the other values that Lightning accepts are "
                "objects, which cannot be options."
            )


def _is_plain(value: Any) -> bool:
    """Whether a value can be in a configuration."""
    if isinstance(value, Mapping):
        return all(map(_is_plain, value.values()))
    return (
        all(map(_is_plain, value)) if isinstance(value, list | tuple) else isinstance(value, bool | int | float | str)
    )


def _is_holdable(annotation: Any) -> bool:
    """Whether values of a type can be in a configuration."""
    arguments = [argument for argument in get_args(annotation) if argument is not Ellipsis]
    if get_origin(annotation) is Literal:
        return True
    if (get_origin(annotation) or annotation) in (list, tuple, dict, Sequence, Mapping):
        return all(map(_is_holdable, arguments))
    return annotation in (Any, bool, int, float, str, Path, type(None))


def _fits(value: Any, annotation: Any) -> bool:
    try:
        converted(value, annotation, "")
    except DeuxError:
        return False
    return True
