"""Callbacks of a training by name: those of Lightning that a configuration can describe, by their constructor.

The names are known without importing Lightning, so that the command line can list and check them fast. Left out are
those that need objects, that find settings instead of training (learning_rate_finder, batch_size_finder), that change
the weights' names (model_pruning), that set the learning rate themselves (stochastic_weight_averaging) or that do what
`deux.training.fit` does anyway (progress bars, on_exception_checkpoint).
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
"""The name of `deux.training.active_collection.ActiveCollection`, which is made where there is a collector for it."""

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
"""Where the class of each callback lies, as "module:Class"."""

_GIVEN: dict[str, dict[str, Any]] = {"throughput_monitor": {"batch_size_fn": lambda batch: len(batch.image)}}
"""Arguments that no configuration can hold."""

_PACKAGES = {"device_stats_monitor": "psutil"}
"""Packages that a callback asks for in the middle of a run; deux does not install them."""


def callback_names() -> list[str]:
    """The names that the configuration's `callbacks` may hold, sorted."""
    return sorted([*CALLBACKS, ACTIVE_COLLECTION])


def make_callback(name: str, settings: Mapping[str, Any]) -> "Callback":
    """A callback by name; `active_collection` is not made here.

    Args:
        name: one of `CALLBACKS`.
        settings: options of its constructor.

    Raises:
        DeuxError: the name is unknown, an option is unknown or missing, a value is refused, or a package is missing.
    """
    if name not in CALLBACKS:
        raise DeuxError(f"callbacks.{name} is no callback: {near_matches(name, callback_names())}")
    package = _PACKAGES.get(name)
    if package is not None and find_spec(package) is None:
        raise DeuxError(f"callbacks.{name} needs the package {package}: install it with pip install {package}.")
    module, _, attribute = CALLBACKS[name].partition(":")
    target: Callable[..., Callback] = getattr(import_module(module), attribute)
    return lightning_object(target, settings, f"callbacks.{name}", _GIVEN.get(name))


def check_monitor(name: str, callback: "Callback", quantities: Sequence[str]) -> None:
    """Find a quantity that no training logs, which Lightning misses in the middle of it.

    Args:
        name: of the callback.
        callback: made by that name.
        quantities: what the training logs.

    Raises:
        DeuxError: the callback watches none of them.
    """
    monitor = getattr(callback, "monitor", None)
    known = [*quantities, *(("epoch", "step") if name == "model_checkpoint" else ())]
    if monitor is not None and monitor not in known and getattr(callback, "strict", True):
        told = "" if any(one.startswith("validation/") for one in known) else ", which has no frames to validate on"
        raise DeuxError(
            f"callbacks.{name}.monitor={monitor} is nothing that this training logs{told}: "
            f"{near_matches(monitor, known)}"
        )


def lightning_object(
    target: Callable[..., T], settings: Mapping[str, Any], where: str, given: Mapping[str, Any] | None = None
) -> T:
    """`deux.options.construct` for a class of Lightning's, whose own complaints become one sentence.

    Args:
        target: the class.
        settings: option values by name.
        where: the settings' place in the configuration, such as "trainer".
        given: arguments that are no options.

    Raises:
        DeuxError: an option is unknown or missing, or its value is refused.
    """
    _check_values(target, settings, where)
    try:
        return construct(target, settings, where, given)
    except DeuxError:
        raise
    except Exception as error:  # Lightning checks few of its arguments, and the others fail in many ways
        sentence = " ".join(str(error).split()).rstrip(".!")
        name = getattr(target, "__name__", str(target))
        raise DeuxError(f"the settings under {where} make no lightning.{name}: {sentence}.") from error


def _check_values(target: Callable[..., Any], settings: Mapping[str, Any], where: str) -> None:
    """Raise DeuxError where a value of the configuration is given for an object, which fails only when it is used."""
    for name, option in options(target).items():
        value = settings.get(name)
        if value is None or not _is_plain(value):
            continue
        kinds = [kind for kind in alternatives(option.annotation) if _is_holdable(kind)]
        if not any(_fits(value, kind) for kind in kinds):
            words = " or ".join(map(describe, kinds)) or "left out"
            raise DeuxError(
                f"{where}.{name} must be {words}, but is {shown(value)}: what else it takes are objects, which no "
                "option can be."
            )


def _is_plain(value: Any) -> bool:
    """Whether a configuration can hold a value."""
    if isinstance(value, Mapping):
        return all(map(_is_plain, value.values()))
    return (
        all(map(_is_plain, value)) if isinstance(value, list | tuple) else isinstance(value, bool | int | float | str)
    )


def _is_holdable(annotation: Any) -> bool:
    """Whether a configuration can hold values of a type."""
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
