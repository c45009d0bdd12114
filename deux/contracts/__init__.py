"""The contracts between the framework and its plugins: simulator, explorer, reward, depth model, loss term.

Read these files first. Nothing here computes; the rest of `deux` provides what is declared here and the plugins
answer to it. Conventions: camera axes are OpenCV's (x right, y down, z forward), poses are camera-to-world in
metres, the world is Y-up, depth runs along the optical axis and 0 means "no value".
"""

from deux.contracts.depth_model import Augmentation, DepthModel, Foundation, LossSettings, Prediction
from deux.contracts.explorer import Episode, Explorer, ExplorerMap, Need, Observation
from deux.contracts.loss import Batch, LossNeed, LossTerm, Reconstructions
from deux.contracts.reward import Experience, Reward
from deux.contracts.robot import Action, Frame, Simulator
from deux.geometry.robot import Robot

__all__ = [
    "Action",
    "Augmentation",
    "Batch",
    "DepthModel",
    "Episode",
    "Experience",
    "Explorer",
    "ExplorerMap",
    "Foundation",
    "Frame",
    "LossNeed",
    "LossSettings",
    "LossTerm",
    "Need",
    "Observation",
    "Prediction",
    "Reconstructions",
    "Reward",
    "Robot",
    "Simulator",
]
