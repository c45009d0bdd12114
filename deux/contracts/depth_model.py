"""The contract of a depth completion model."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from torch import Tensor, nn

from deux.inference.prediction import predict


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


Augmentation = Callable[[dict[str, Tensor]], dict[str, Tensor]]
"""A transform of a training sample, such as those of `torchvision.transforms.v2`; see `deux.data.transforms`."""

LossSettings = Mapping[str, float | Mapping[str, Any]]
"""Loss terms by registered name: a weight, or {"weight": w, **options of the term's constructor}."""


class DepthModel(nn.Module, ABC):
    """A depth completion network. All options are in the constructor, each with its published default."""

    supervised: ClassVar[bool] = False
    """Whether the objective may read ground truth. The data module loads it for supervised models only.

    This and `objective` may be set in the constructor where they depend on the options.
    """

    pretrained: ClassVar[bool] = False
    """Whether the constructor loads trained weights: such a model needs no checkpoint and no training."""

    objective: ClassVar[LossSettings] = {}
    """The published loss terms and weights."""

    min_depth: float
    """Nearest depth in metres that the model predicts."""

    max_depth: float
    """Farthest depth in metres that the model predicts."""

    save_pretrained: Callable[..., Path]
    """Writes the model as a folder to share, see `deux.deployment.model_folders`; a model that was loaded has it."""

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

    @property
    def prepares(self) -> bool:
        """Whether it has further inputs. Where it has none, `predict` leaves the points on their device."""
        return type(self).prepare is not DepthModel.prepare

    def augmentation(self) -> Sequence[Augmentation]:
        """The published augmentation: applied in order to each training sample, after the crop, never in evaluation.

        torchvision is best imported inside: it takes as long as all the rest that a model needs for inference.
        """
        return ()

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

    published_prefix: ClassVar[str] = ""
    """What the published code has before every name in these: "module." where it wraps modules in DataParallel."""

    published_options: ClassVar[Mapping[str, Any]] = {}
    """Options that a model with published weights has, unless others are asked for, to compute what that code does."""

    size_multiple: ClassVar[int] = 1
    """`predict` pads images to a multiple of this many pixels and crops the result."""

    def predict(self, image: Tensor, sparse_depth: Tensor, intrinsics: Tensor) -> Tensor:
        """Predict dense depth from plain camera data; see `deux.inference.prediction.predict`.

        Args:
            image: N x 3 x H x W in [0, 1].
            sparse_depth: N x 1 x H x W metres, 0 = none.
            intrinsics: N x 3 x 3.

        Returns:
            N x 1 x H x W float32 metres.
        """
        return predict(self, image, sparse_depth, intrinsics)
