"""A depth model that is small enough to be measured in no time, and flats that are generated once."""

from collections.abc import Callable
from functools import cache
from typing import Any, ClassVar

import pytest
import torch
from torch import Tensor, nn

from deux.bench.bench_scenes import flats
from deux.contracts import DepthModel, LossSettings, Prediction
from deux.registry import registry


class TinyPoses(nn.Module):
    def __init__(self) -> None:
        super().__init__()
        self.shift = nn.Parameter(torch.zeros(()))

    def forward(self, target: Tensor, source: Tensor) -> Tensor:
        return torch.eye(4).repeat(len(target), 1, 1) + 1e-3 * self.shift


class TinyModel(DepthModel):
    objective: ClassVar[LossSettings] = {"color_consistency": 1.0, "sparse_depth": 1.0}
    min_depth, max_depth = 0.1, 10.0

    def __init__(self) -> None:
        super().__init__()
        self.layer = nn.Conv2d(4, 1, 3, padding=1)

    def forward(
        self, image: Tensor, sparse_depth: Tensor, validity: Tensor, intrinsics: Tensor, **prepared: Tensor
    ) -> Prediction:
        return Prediction(0.1 + 9.9 * torch.sigmoid(self.layer(torch.cat([image, sparse_depth], dim=1))))

    def pose_network(self) -> TinyPoses:
        return TinyPoses()


class DemandingModel(TinyModel):
    def __init__(self, size: int) -> None:
        super().__init__()


@pytest.fixture
def tiny_models(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing but a tiny depth model and one that cannot be made without options."""
    registry().names("depth_models")  # fills the table, so that it comes back afterwards
    monkeypatch.setitem(registry()._plugins, "depth_models", [])
    registry().register("depth_models", "tiny", TinyModel)
    registry().register("depth_models", "demanding", DemandingModel)


@pytest.fixture(scope="session")
def load_once() -> Callable[..., Any]:
    """How a flat is loaded, whose second load is the same one."""
    return cache(type(flats(1)[0]).load)


@pytest.fixture(autouse=True)
def flats_are_generated_once(load_once: Callable[..., Any], monkeypatch: pytest.MonkeyPatch) -> None:
    """A flat takes a second to generate, and most measurements load the same ones again and again."""
    monkeypatch.setattr(type(flats(1)[0]), "load", load_once)
