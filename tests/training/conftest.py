"""A small depth model, endless copies of one analytic batch, and a training run that leaves nothing behind."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, ClassVar

import pytest
import torch
from lightning.pytorch import LightningModule, Trainer
from torch import Tensor, nn

from deux.contracts import Batch, DepthModel, LossSettings, Prediction
from deux.testing.losses import perfect_sample


class SmallModel(DepthModel):
    """Three convolutions from image and points to the logarithm of depth."""

    objective: ClassVar[LossSettings] = {
        "color_consistency": 0.15,
        "structural_consistency": 0.95,
        "sparse_depth": 2.0,
        "local_smoothness": 0.1,
    }

    def __init__(self, start: float = 3.0) -> None:
        super().__init__()
        self.min_depth, self.max_depth = 0.1, 10.0
        self.layers = nn.Sequential(
            nn.Conv2d(5, 16, 5, padding=2),
            nn.ReLU(),
            nn.Conv2d(16, 16, 5, padding=2),
            nn.ReLU(),
            nn.Conv2d(16, 1, 1),
        )
        self.start = start

    def forward(
        self, image: Tensor, sparse_depth: Tensor, validity: Tensor, intrinsics: Tensor, **prepared: Tensor
    ) -> Prediction:
        logits = self.layers(torch.cat([image, sparse_depth, validity], dim=1))
        return Prediction((self.start * logits.float().exp()).clamp(self.min_depth, self.max_depth))

    def pose_network(self) -> nn.Module:
        return SmallPoseNetwork()


class SmallPoseNetwork(nn.Module):
    """One convolution from two images to a translation."""

    def __init__(self) -> None:
        super().__init__()
        self.layer = nn.Conv2d(6, 3, 3)

    def forward(self, target: Tensor, source: Tensor) -> Tensor:
        translation = 0.1 * self.layer(torch.cat([target, source], dim=1)).mean(dim=(2, 3))
        pose = torch.eye(4, device=target.device).repeat(len(target), 1, 1)
        pose[:, :3, 3] = translation.float()
        return pose


class Repeated:
    """A loader that gives one batch again and again."""

    def __init__(self, batch: Batch, times: int) -> None:
        self.batch, self.times = batch, times

    def __len__(self) -> int:
        return self.times

    def __iter__(self) -> Iterator[Batch]:
        return iter([self.batch] * self.times)


@pytest.fixture
def prepared_sample() -> Callable[[DepthModel, int, int], Batch]:
    """Two analytic frames with a model's further inputs: prepared_sample(model, height, width)."""

    def make(model: DepthModel, height: int, width: int) -> Batch:
        batch = perfect_sample(2, height, width).batch
        samples = [model.prepare(depth) for depth in batch.sparse_depth[:, 0].numpy()]
        batch.prepared = {key: torch.stack([torch.from_numpy(sample[key]) for sample in samples]) for key in samples[0]}
        return batch

    return make


@pytest.fixture
def small_model() -> type[SmallModel]:
    return SmallModel


@pytest.fixture
def fit() -> Callable[..., Trainer]:
    """Fits a module to copies of one batch, on the CPU and without validation, logs, bars and files.

    Further arguments are the trainer's; validation, if asked for, sees the same copies.
    """

    def run(
        module: LightningModule, batch: Batch, copies: int, checkpoint: Path | None = None, **arguments: Any
    ) -> Trainer:
        quiet = {
            "accelerator": "cpu",
            "logger": False,
            "enable_checkpointing": False,
            "enable_progress_bar": False,
            "enable_model_summary": False,
            "limit_val_batches": 0,
        }
        trainer = Trainer(**quiet | arguments)
        loader = Repeated(batch, copies)
        trainer.fit(module, loader, loader, ckpt_path=checkpoint, weights_only=True)
        return trainer

    return run
