"""Callbacks of a training by name: those of Lightning that need no code, with their options from the constructor.

The names are known without importing Lightning, so that the command line can list and check them fast.
"""

from collections.abc import Callable, Mapping
from importlib import import_module
from typing import TYPE_CHECKING, Any, TypeVar

from deux.errors import DeuxError, near_matches
from deux.options import construct

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
    "on_exception_checkpoint": "OnExceptionCheckpoint",
    "rich_model_summary": "RichModelSummary",
    "stochastic_weight_averaging": "StochasticWeightAveraging",
    "throughput_monitor": "ThroughputMonitor",
    "timer": "Timer",
    "weight_averaging": "WeightAveraging",
}

CALLBACKS: dict[str, str] = {name: f"lightning.pytorch.callbacks:{cls}" for name, cls in _LIGHTNING.items()}
"""Where the class of each callback lies, as "module:Class"."""

_GIVEN: dict[str, dict[str, Any]] = {"throughput_monitor": {"batch_size_fn": lambda batch: len(batch.image)}}
"""Arguments that no configuration can hold."""


def callback_names() -> list[str]:
    """The names that the configuration's `callbacks` may hold, sorted."""
    return sorted([*CALLBACKS, ACTIVE_COLLECTION])


def make_callback(name: str, settings: Mapping[str, Any]) -> "Callback":
    """A callback by name; `active_collection` is not made here.

    Args:
        name: one of `CALLBACKS`.
        settings: options of its constructor.

    Raises:
        DeuxError: the name is unknown, an option is unknown or missing, or a value is refused.
    """
    if name not in CALLBACKS:
        raise DeuxError(f"callbacks.{name} is no callback: {near_matches(name, callback_names())}")
    module, _, attribute = CALLBACKS[name].partition(":")
    target: Callable[..., Callback] = getattr(import_module(module), attribute)
    return lightning_object(target, settings, f"callbacks.{name}", _GIVEN.get(name))


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
    from lightning.pytorch.utilities.exceptions import MisconfigurationException

    try:
        return construct(target, settings, where, given)
    except (MisconfigurationException, TypeError, ValueError, ModuleNotFoundError) as error:
        sentence = " ".join(str(error).split()).removesuffix(".")
        name = getattr(target, "__name__", str(target))
        raise DeuxError(f"the settings under {where} make no lightning.{name}: {sentence}.") from error
