"""The contract of a loss term: a function of the batch, the prediction and the reconstructions to a scalar."""

from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from enum import StrEnum

from torch import Tensor

from deux.contracts.depth_model import Prediction


class LossNeed(StrEnum):
    """What a loss term may request from the objective."""

    RECONSTRUCTIONS = "reconstructions"
    BACKWARD_POSES = "backward_poses"
    GROUND_TRUTH = "ground_truth"


@dataclass
class Batch:
    """A batch of training samples: frame t with its S source frames (t-1 and t-2).

    Args:
        image: N x 3 x H x W in [0, 1], frame t, the target.
        sources: N x S x 3 x H x W in [0, 1]; S is 0 if no term needs reconstructions, and in evaluation.
        sparse_depth: N x 1 x H x W metres, 0 = none; the points that the losses compare with.
        validity: N x 1 x H x W, 1 where a sparse point survives outlier removal.
        input_sparse_depth: N x 1 x H x W, the points that are input to the network (thinned by augmentation).
        intrinsics: N x 3 x 3.
        source_from_target: N x S x 4 x 4, transforms points of camera t to each source camera (from the robot's poses),
            to be projected with `intrinsics`. Where a source frame has intrinsics of its own, the matrix accounts for
            them (`deux.geometry.poses.absorb_intrinsics`). None if the frames have no poses.
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
        source_from_target: N x S x 4 x 4, the poses used (the robot's or the pose network's).
        target_from_source: the backward poses; None unless a term declared `LossNeed.BACKWARD_POSES`.
    """

    images: Tensor
    visible: Tensor
    source_from_target: Tensor
    target_from_source: Tensor | None = None


@dataclass(frozen=True)
class LossInputs:
    """The input of a loss term.

    Args:
        batch: the samples, without ground truth unless the model is supervised.
        prediction: the depth model's output, float32, with the extras that the term declared.
        reconstructions: the target frames rebuilt from their sources; None if no term of the objective needs them.
        depth_range: least and greatest depth in metres that the model predicts.
    """

    batch: Batch
    prediction: Prediction
    reconstructions: Reconstructions | None
    depth_range: tuple[float, float]


class LossTerm(ABC):
    """One term of the objective, unweighted. All options are in the constructor."""

    needs: frozenset[LossNeed] = frozenset()
    """What the objective must compute or load for the term."""

    extras: frozenset[str] = frozenset()
    """Keys of `Prediction.extras` that the term reads; it works only with models that predict them."""

    @abstractmethod
    def __call__(self, inputs: LossInputs) -> Tensor:
        """Compute the term's value: a float32 scalar, finite for every batch."""
