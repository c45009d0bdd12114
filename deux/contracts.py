"""The contracts between the framework and its plugins: explorer, depth model, loss term, simulator.

Read this file first. Nothing here computes; the rest of `deux` provides what is declared here and the plugins
answer to it. Conventions: camera axes are OpenCV's (x right, y down, z forward), poses are camera-to-world in
metres, the world is Y-up, depth runs along the optical axis and 0 means "no value".
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import IntEnum, StrEnum
from typing import Any, ClassVar, Protocol

import numpy as np
from torch import Tensor, nn

from deux.geometry.camera import Camera
from deux.geometry.grid import FreeSpace, GridFrame
from deux.geometry.robot import Robot

# ---------------------------------------------------------------------------------------------- robot and simulator


class Action(IntEnum):
    """What the robot can do in one step."""

    FORWARD = 0
    LEFT = 1
    RIGHT = 2
    STOP = 3


@dataclass(frozen=True)
class Frame:
    """What the robot's camera records at one pose.

    Args:
        rgb: H x W x 3 uint8.
        depth: H x W float32 in metres, 0 where the camera sees nothing within its range.
        pose: 4 x 4 float64, camera-to-world.
        labels: H x W int32, index into `Simulator.label_names`, -1 where nothing is labelled; None unless asked for.
    """

    rgb: np.ndarray
    depth: np.ndarray
    pose: np.ndarray
    labels: np.ndarray | None = None


class Simulator(Protocol):
    """One robot in one scene."""

    camera: Camera
    robot: Robot
    label_names: tuple[str, ...]

    def reset(self, x: float, z: float, yaw: float) -> None:
        """Put the robot on the floor at world (x, z), metres, heading `yaw` (radians, 0 looks along -Z)."""

    def step(self, action: Action) -> bool:
        """Carry out one action; true if the robot touched something and moved less than it was told to."""

    @property
    def pose(self) -> np.ndarray:
        """The camera's present camera-to-world matrix, 4 x 4 float64."""

    def observe(self, labels: bool = False) -> Frame:
        """Render what the camera sees now."""

    def free_space(self) -> FreeSpace:
        """The true free floor that is connected to the robot's main floor. Privileged: no agent sees it unasked."""


# -------------------------------------------------------------------------------------------------------- explorer


class Need(StrEnum):
    """What an explorer may ask the collector for, beyond the pose and the colour image."""

    SENSOR_DEPTH = "sensor_depth"
    PREDICTED_DEPTH = "predicted_depth"
    RESIDUAL = "residual"
    LABELS = "labels"
    FREE_SPACE = "free_space"


@dataclass(frozen=True)
class Episode:
    """What an explorer is told once, before its first step in a scene.

    Args:
        seed: seed of everything random in the explorer; the same seed gives the same actions.
        steps: number of actions that the episode lasts.
        camera: the robot's camera.
        robot: the robot's body and motion.
        free_space: the true free floor; None unless the explorer declared `Need.FREE_SPACE`.
    """

    seed: int
    steps: int
    camera: Camera
    robot: Robot
    free_space: FreeSpace | None = None


@dataclass(frozen=True)
class Observation:
    """What an explorer sees before each action. What it did not declare in `needs` is None.

    Args:
        step: 0 before the first action.
        pose: 4 x 4 float64, the camera's camera-to-world matrix.
        collided: whether the last action was cut short by an obstacle.
        rgb: H x W x 3 uint8.
        sensor_depth: H x W float32, metres, 0 = none.
        predicted_depth: H x W float32, metres: the depth model's output for this frame.
        residual: H x W float32, the mean absolute photometric error of both reconstructions of this frame, images
            in [0, 1]; NaN where neither source frame sees the pixel, all NaN before the third frame.
        uncertainty: delta of Eq. 8 in [0, 1], the residual as one number; NaN before the third frame. Comes with
            `residual`.
        labels: H x W int32, -1 = unlabelled.
    """

    step: int
    pose: np.ndarray
    collided: bool
    rgb: np.ndarray
    sensor_depth: np.ndarray | None = None
    predicted_depth: np.ndarray | None = None
    residual: np.ndarray | None = None
    uncertainty: float | None = None
    labels: np.ndarray | None = None


@dataclass(frozen=True)
class ExplorerMap:
    """What an explorer knows of the floor, for figures.

    Args:
        frame: where the grids lie.
        occupancy: rows x columns int8: 0 unknown, 1 occupied, 2 free.
        uncertainty: rows x columns float32, the explorer's uncertainty field, NaN where it has none; or None.
    """

    frame: GridFrame
    occupancy: np.ndarray
    uncertainty: np.ndarray | None = None


class Explorer(ABC):
    """Decides where the robot goes. One instance explores one scene at a time; all options are in the constructor."""

    needs: frozenset[Need] = frozenset()
    """What each observation must carry. May be set in the constructor where it depends on the options."""

    @abstractmethod
    def reset(self, episode: Episode) -> None:
        """Forget everything and begin an episode."""

    @abstractmethod
    def act(self, observation: Observation) -> Action:
        """Choose the next action. `Action.STOP` ends the episode before its time."""

    def map(self) -> ExplorerMap | None:
        """The map as it stands, for figures; None if the explorer keeps none."""
        return None


# ----------------------------------------------------------------------------------------------------- depth model


@dataclass
class Prediction:
    """What a depth model returns.

    Args:
        depth: N x 1 x H x W float32, metres.
        extras: further N x C x H x W tensors for the model's own losses, by name (such as "prior").
    """

    depth: Tensor
    extras: dict[str, Tensor] = field(default_factory=dict)


@dataclass(frozen=True)
class Augmentation:
    """A model's published training augmentation.

    Args:
        drop_points: (least, most) fraction of the sparse points that is hidden from the network (never from the
            loss), drawn anew for each sample; None hides none.
        flip: probability that a sample is mirrored left to right (intrinsics and poses with it).
    """

    drop_points: tuple[float, float] | None = None
    flip: float = 0.0


@dataclass(frozen=True)
class Foundation:
    """A depth model inside another one: trained before it, and frozen while it trains.

    Args:
        name: the registered name under which it is made and trained by itself.
        settings: the options that make it such that its weights fit the module.
        module: where its weights go; part of the model that is built on it.
    """

    name: str
    settings: Mapping[str, Any]
    module: nn.Module


LossSettings = Mapping[str, float | Mapping[str, Any]]
"""Loss terms by registered name: a weight, or {"weight": w, **options of the term's constructor}."""


class DepthModel(nn.Module, ABC):
    """A depth completion network. All options are in the constructor, each with its published default."""

    supervised: ClassVar[bool] = False
    """Whether the objective may read ground truth. The data module loads it for supervised models only."""

    objective: ClassVar[LossSettings] = {}
    """The published loss terms and weights."""

    augmentation: ClassVar[Augmentation] = Augmentation()
    """The published augmentation."""

    min_depth: float
    """Nearest depth in metres that the model predicts."""

    max_depth: float
    """Farthest depth in metres that the model predicts."""

    @abstractmethod
    def forward(
        self, image: Tensor, sparse_depth: Tensor, validity: Tensor, intrinsics: Tensor, **prepared: Tensor
    ) -> Prediction:
        """Predict dense depth.

        Args:
            image: N x 3 x H x W in [0, 1].
            sparse_depth: N x 1 x H x W metres, 0 = none, as sampled (outliers included).
            validity: N x 1 x H x W, 1 where a sparse point survives outlier removal, else 0.
            intrinsics: N x 3 x 3.
            **prepared: what `prepare` returned, batched, N x C x H x W.
        """

    def prepare(self, sparse_depth: np.ndarray) -> dict[str, np.ndarray]:
        """Further inputs computed on the CPU in the data workers, from H x W metres; each C x H x W float32."""
        return {}

    def pose_network(self) -> nn.Module | None:
        """The model's published pose network, newly made, or None if the model has none.

        Called as `network(target_image, source_image)`, each N x 3 x H x W, it returns N x 4 x 4: the matrix that
        carries points of the target camera into the source camera.
        """
        return None

    def foundation(self) -> Foundation | None:
        """The depth model that this one is built on, or None if it stands alone.

        Before this model is trained, the framework fills the foundation's module with trained weights
        (`foundation.checkpoint`) or trains such a model first.
        """
        return None

    def published_modules(self) -> dict[str, nn.Module]:
        """The published checkpoint's sub-dictionaries and the modules whose state they hold, key by key."""
        return {}

    size_multiple: ClassVar[int] = 1
    """`predict` pads images to a multiple of this many pixels and crops the result."""

    def predict(self, image: Tensor, sparse_depth: Tensor, intrinsics: Tensor) -> Tensor:
        """Predict dense depth from plain camera data; see `deux.training.prediction.predict`.

        Args:
            image: N x 3 x H x W in [0, 1].
            sparse_depth: N x 1 x H x W metres, 0 = none.
            intrinsics: N x 3 x 3.

        Returns:
            N x 1 x H x W float32 metres.
        """
        # The contracts compute nothing: this is the one door from them to the framework.
        from deux.training.prediction import predict

        return predict(self, image, sparse_depth, intrinsics)


# ------------------------------------------------------------------------------------------------------- loss term


class LossNeed(StrEnum):
    """What a loss term may ask for."""

    RECONSTRUCTIONS = "reconstructions"
    BACKWARD_POSES = "backward_poses"
    PRIOR = "prior"
    GROUND_TRUTH = "ground_truth"


@dataclass
class Batch:
    """A batch of training samples: frame t with its S source frames (t-1 and t-2).

    Args:
        image: N x 3 x H x W in [0, 1], frame t, the target.
        sources: N x S x 3 x H x W in [0, 1].
        sparse_depth: N x 1 x H x W metres, 0 = none; what the losses compare with.
        validity: N x 1 x H x W, 1 where a sparse point survives outlier removal.
        input_sparse_depth: N x 1 x H x W, the points that the network is shown (thinned by augmentation).
        intrinsics: N x 3 x 3.
        source_from_target: N x S x 4 x 4, carries points of camera t into each source camera (the robot's poses).
        ground_truth: N x 1 x H x W metres, 0 = none; None unless the model is supervised or this is evaluation.
        prepared: the model's further inputs, by name.
    """

    image: Tensor
    sources: Tensor
    sparse_depth: Tensor
    validity: Tensor
    input_sparse_depth: Tensor
    intrinsics: Tensor
    source_from_target: Tensor
    ground_truth: Tensor | None = None
    prepared: dict[str, Tensor] = field(default_factory=dict)


@dataclass
class Reconstructions:
    """Frame t rebuilt from each source frame with the predicted depth (Eq. 1).

    Args:
        images: N x S x 3 x H x W.
        visible: N x S x 1 x H x W bool, false where the point lies behind the source camera or outside its image.
        source_from_target: N x S x 4 x 4, the poses that were used (the robot's or the pose network's).
        target_from_source: the backward poses; None unless a term declared `LossNeed.BACKWARD_POSES`.
    """

    images: Tensor
    visible: Tensor
    source_from_target: Tensor
    target_from_source: Tensor | None = None


class LossTerm(ABC):
    """One term of the objective, unweighted. All options are in the constructor."""

    needs: frozenset[LossNeed] = frozenset()
    """What must be computed for the term; `reconstructions` is None unless some term declares it."""

    @abstractmethod
    def __call__(self, batch: Batch, prediction: Prediction, reconstructions: Reconstructions | None) -> Tensor:
        """The term's value, a float32 scalar, finite for every batch."""
