"""The contract of a loss term: a function of the batch, the prediction and the reconstructions to a scalar."""

from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from enum import StrEnum

from torch import Tensor

from deux.contracts.depth_model import Prediction


class LossNeed(StrEnum):
    """What a loss term may ask the objective for."""

    RECONSTRUCTIONS = "reconstructions"
    BACKWARD_POSES = "backward_poses"
    GROUND_TRUTH = "ground_truth"


@dataclass
class Batch:
    """A batch of training samples: frame t with its S source frames (t-1 and t-2).

    Args:
        image: N x 3 x H x W in [0, 1], frame t, the target.
        sources: N x S x 3 x H x W in [0, 1]; S is 0 where no term asks for reconstructions, and in evaluation.
        sparse_depth: N x 1 x H x W metres, 0 = none; what the losses compare with.
        validity: N x 1 x H x W, 1 where a sparse point survives outlier removal.
        input_sparse_depth: N x 1 x H x W, the points that the network is shown (thinned by augmentation).
        intrinsics: N x 3 x 3.
        source_from_target: N x S x 4 x 4, carries points of camera t into each source camera (the robot's poses), for
            `intrinsics` to project them; a source frame's own camera, where it differs, is part of it
            (`deux.geometry.poses.projecting_alike`). None where the frames have no poses.
        ground_truth: N x 1 x H x W metres, 0 = none; None unless the model is supervised or this is evaluation.
        prepared: the model's further inputs, by name.
    """

    image: Tensor
    sources: Tensor
    sparse_depth: Tensor
    validity: Tensor
    input_sparse_depth: Tensor
    intrinsics: Tensor
    source_from_target: Tensor | None
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


@dataclass(frozen=True)
class LossInputs:
    """What a loss term computes its value from.

    Args:
        batch: the samples; without ground truth unless the model is supervised.
        prediction: the depth model's output for them, float32; it holds the extras that the term declared.
        reconstructions: the rebuilt target frames; None if no term of the objective declared that it needs them.
        depth_range: (nearest, farthest) depth in metres that the model predicts.
    """

    batch: Batch
    prediction: Prediction
    reconstructions: Reconstructions | None
    depth_range: tuple[float, float]


class LossTerm(ABC):
    """One term of the objective, unweighted. All options are in the constructor."""

    needs: frozenset[LossNeed] = frozenset()
    """What must be computed or loaded for the term."""

    extras: frozenset[str] = frozenset()
    """Names in `Prediction.extras` that the term reads; a model that does not predict them cannot train with it."""

    @abstractmethod
    def __call__(self, inputs: LossInputs) -> Tensor:
        """The term's value, a float32 scalar, finite for every batch."""
