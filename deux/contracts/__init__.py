"""The contracts between the framework and its plugins: one for each of the eight kinds.

Read these files first. They hold the abstract classes that plugins implement and the types that the framework passes
to them. Conventions: camera axes are OpenCV's (x right, y down, z forward), poses are camera-to-world in metres, the
world is Y-up, depth is measured along the optical axis and 0 means "no value".
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from deux.contracts.explorer import NO_ROBOT, Episode, Explorer, ExplorerMap, FreeViewpoints, Need, Observation
from deux.contracts.reader import FrameReference, MissingSplit, Neighbourhood, Reader, Triplet
from deux.contracts.reward import Experience, Reward
from deux.contracts.scene import (
    Floor,
    Material,
    Scene,
    SceneArea,
    SceneFiles,
    SceneMesh,
    SceneReference,
    SceneSource,
    SceneSplits,
)
from deux.contracts.simulator import COLOR, DEPTH, Action, Channel, Channels, Frame, Simulator
from deux.geometry.robot import Robot

if TYPE_CHECKING:
    from deux.contracts.depth_model import Augmentation, DepthModel, Foundation, LossSettings, Prediction
    from deux.contracts.loss import Batch, LossInputs, LossNeed, LossTerm, Reconstructions
    from deux.contracts.uncertainty import DepthPredictor, Uncertainty, View

__all__ = [
    "COLOR",
    "DEPTH",
    "NO_ROBOT",
    "Action",
    "Augmentation",
    "Batch",
    "Channel",
    "Channels",
    "DepthModel",
    "DepthPredictor",
    "Episode",
    "Experience",
    "Explorer",
    "ExplorerMap",
    "Floor",
    "Foundation",
    "Frame",
    "FrameReference",
    "FreeViewpoints",
    "LossInputs",
    "LossNeed",
    "LossSettings",
    "LossTerm",
    "Material",
    "MissingSplit",
    "Need",
    "Neighbourhood",
    "Observation",
    "Prediction",
    "Reader",
    "Reconstructions",
    "Reward",
    "Robot",
    "Scene",
    "SceneArea",
    "SceneFiles",
    "SceneMesh",
    "SceneReference",
    "SceneSource",
    "SceneSplits",
    "Simulator",
    "Triplet",
    "Uncertainty",
    "View",
]

WITH_TORCH = {
    **dict.fromkeys(["Augmentation", "DepthModel", "Foundation", "LossSettings", "Prediction"], "depth_model"),
    **dict.fromkeys(["Batch", "LossInputs", "LossNeed", "LossTerm", "Reconstructions"], "loss"),
    **dict.fromkeys(["DepthPredictor", "Uncertainty", "View"], "uncertainty"),
}
"""Modules of the contracts that import torch, which processes that only make or render scenes do not wait for."""


def __getattr__(name: str) -> Any:
    """Import one of the contracts `WITH_TORCH` at its first use (PEP 562)."""
    if name not in WITH_TORCH:
        raise AttributeError(f"module 'deux.contracts' has no attribute {name!r}")
    return getattr(import_module(f"deux.contracts.{WITH_TORCH[name]}"), name)


def __dir__() -> list[str]:
    """The public names, for completion in notebooks."""
    return sorted(__all__)
