"""The installed plugins to measure, and the depth model that guides explorers."""

from typing import Any, NamedTuple

from deux.contracts import FreeViewpoints, Uncertainty
from deux.errors import DeuxError
from deux.inference.precision import FastPredictor
from deux.registry import PluginChoice, registry
from deux.simulator.renderers import RENDERERS

UNCERTAINTY = "l1"
"""The measure of uncertainty, the paper's (Eq. 8)."""

BUILT_IN_SIMULATOR = "mesh"


class Guide(NamedTuple):
    """What explorers that need a depth model are guided by.

    Args:
        name: of the depth model.
        predict_depth: the model, untrained, on the device and in the precision that the collector chooses as well.
        uncertainty: judges its predictions.
    """

    name: str
    predict_depth: FastPredictor
    uncertainty: Uncertainty


def installed(kind: str) -> tuple[dict[str, Any], tuple[str, ...]]:
    """One of each installed plugin of a kind, with its default options, by name; and a note on each broken one.

    Free viewpoints, which take no steps, are no explorer here.
    """
    made, notes = {}, []
    for name in registry().names(kind):
        try:
            made[name] = registry().create(kind, name, {})
        except DeuxError as error:
            notes.append(f"{name} is left out: {error}")
    return {name: one for name, one in made.items() if not isinstance(one, FreeViewpoints)}, tuple(notes)


def make_guide(model_name: str | None, accelerator: str = "auto") -> Guide | None:
    """Make the guide of explorers.

    Args:
        model_name: its depth model; by default the first that is installed and trains without ground truth.
        accelerator: Lightning's accelerator setting.

    Returns:
        None if no model is named and none is installed.

    Raises:
        DeuxError: there is no such model.
    """
    model_name = model_name or default_model()
    if model_name is None:
        return None
    model = registry().create("depth_models", model_name, {}).eval()
    return Guide(model_name, FastPredictor(model, accelerator), registry().create("uncertainties", UNCERTAINTY, {}))


def default_model() -> str | None:
    """Name of the first installed depth model that trains without ground truth; None if there is none."""
    models, _ = installed("depth_models")
    return next((name for name, model in models.items() if not model.supervised), None)


def renderers() -> dict[str, PluginChoice]:
    """Simulators by the name of what draws: the built-in one with each of its renderers, then all others as they are.

    They are not imported yet, so some may be broken.
    """
    found = {name: PluginChoice("simulators", BUILT_IN_SIMULATOR, {"renderer": name}) for name in RENDERERS}
    others = [name for name in registry().names("simulators") if name != BUILT_IN_SIMULATOR]
    return found | {name: PluginChoice("simulators", name, {}) for name in others}
