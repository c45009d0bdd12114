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
        extras: further N x C x H x W tensors by name (such as "prior"), for loss terms that declare them.
    """

    depth: Tensor
    extras: dict[str, Tensor] = field(default_factory=dict)


@dataclass(frozen=True)
class Foundation:
    """A depth model inside another one: it is trained first, and frozen while the outer model trains.

    Args:
        name: its registered name, under which it is also trained on its own.
        settings: the options for which its weights match the module's.
        module: the submodule of the outer model that its weights are loaded into.
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
    """Whether the constructor loads trained weights; such a model needs neither a checkpoint nor training."""

    objective: ClassVar[LossSettings] = {}
    """The published loss terms and weights."""

    min_depth: float
    """Nearest depth in metres that the model predicts."""

    max_depth: float
    """Farthest depth in metres that the model predicts."""

    save_pretrained: Callable[..., Path]
    """Writes the model to a folder for sharing (`deux.deployment.model_folders`). Set on models that were loaded."""

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
        """Compute further inputs of `forward`, on the CPU in the data loader's workers.

        Args:
            sparse_depth: H x W metres, 0 = none.

        Returns:
            C x H x W float32 arrays by the name of `forward`'s parameter.
        """
        return {}

    @property
    def prepares(self) -> bool:
        """Whether the model overrides `prepare`. If it does not, `predict` keeps the points on their device."""
        return type(self).prepare is not DepthModel.prepare

    def augmentation(self) -> Sequence[Augmentation]:
        """The published augmentation, applied in order to each training sample after the crop; not used in evaluation.

        Import torchvision inside this method: that takes as long as all other imports of inference together.
        """
        return ()

    def pose_network(self) -> nn.Module | None:
        """A new instance of the model's published pose network, or None if the model has none.

        It is called as `network(target_image, source_image)`, each N x 3 x H x W, and returns N x 4 x 4: the transform
        from the target camera's coordinates to the source camera's.
        """
        return None

    def foundation(self) -> Foundation | None:
        """The depth model that this one is built on, or None.

        Before this model is trained, the framework loads trained weights into the foundation's module: those of
        `foundation.checkpoint`, or those of a foundation that it trains first.
        """
        return None

    def published_modules(self) -> dict[str, nn.Module]:
        """The modules whose state the published checkpoint holds, by the key of their state dict in it."""
        return {}

    published_prefix: ClassVar[str] = ""
    """Prefix of every parameter name in the published state dicts, such as "module." from DataParallel."""

    published_options: ClassVar[Mapping[str, Any]] = {}
    """Options that reproduce the published code; the defaults of a model that is loaded with published weights."""

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
