"""Installed plugins to measure, and the depth model that guides explorers."""

from typing import Any, NamedTuple

from deux.contracts import FreeViewpoints, Uncertainty
from deux.errors import DeuxError
from deux.inference.precision import FastPredictor
from deux.registry import PluginChoice, registry
from deux.simulator.renderers import RENDERERS

UNCERTAINTY = "l1"
"""Name of the uncertainty that guides explorers: that of the paper (Eq. 8)."""

BUILT_IN_SIMULATOR = "mesh"


class Guide(NamedTuple):
    """Depth model and uncertainty that guide the explorers that need them.

    Args:
        name: name of the depth model.
        predict_depth: the untrained model, on the device and in the precision that the collector uses.
        uncertainty: uncertainty of its predictions.
    """

    name: str
    predict_depth: FastPredictor
    uncertainty: Uncertainty


def installed(kind: str) -> tuple[dict[str, Any], tuple[str, ...]]:
    """Create each installed plugin of a kind with its default options.

    Explorers that choose free viewpoints (`FreeViewpoints`) are excluded, since they take no steps.

    Returns:
        The plugins by name, and a note on each plugin that cannot be created.
    """
    made, notes = {}, []
    for name in registry().names(kind):
        try:
            made[name] = registry().create(kind, name, {})
        except DeuxError as error:
            notes.append(f"{name} is left out: {error}")
    return {name: one for name, one in made.items() if not isinstance(one, FreeViewpoints)}, tuple(notes)


def make_guide(model_name: str | None, accelerator: str = "auto") -> Guide | None:
    """Create an untrained depth model and the uncertainty that guide explorers.

    Args:
        model_name: name of the depth model; None for the first installed model that trains without ground truth.
        accelerator: Lightning's accelerator setting.

    Returns:
        The guide; None if `model_name` is None and no suitable model is installed.

    Raises:
        DeuxError: the model does not exist.
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
    """Choices of simulators by renderer: the built-in simulator with each of its renderers, then all other simulators.

    They are not imported, so some of them may not work.
    """
    found = {name: PluginChoice("simulators", BUILT_IN_SIMULATOR, {"renderer": name}) for name in RENDERERS}
    others = [name for name in registry().names("simulators") if name != BUILT_IN_SIMULATOR]
    return found | {name: PluginChoice("simulators", name, {}) for name in others}
