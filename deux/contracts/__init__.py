"""The contracts between the framework and its plugins: one for each of the eight kinds.

Read these files first. They hold the abstract classes that plugins implement and the types that the framework passes
to them. Conventions: camera axes are OpenCV's (x right, y down, z forward), poses are camera-to-world in metres, the
world is Y-up, depth is measured along the optical axis and 0 means "no value".
"""

from deux.contracts.depth_model import Augmentation, DepthModel, Foundation, LossSettings, Prediction
from deux.contracts.explorer import NO_ROBOT, Episode, Explorer, ExplorerMap, FreeViewpoints, Need, Observation
from deux.contracts.loss import Batch, LossInputs, LossNeed, LossTerm, Reconstructions
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
from deux.contracts.uncertainty import DepthPredictor, Uncertainty, View
from deux.geometry.robot import Robot

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
