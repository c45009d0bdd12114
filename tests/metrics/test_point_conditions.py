"""Errors with other points than the stored ones."""

from pathlib import Path

import numpy as np
import pytest
import torch
from torch import Tensor, nn
from void_layout import dataset as written

from deux.contracts import DepthModel, Prediction
from deux.data.dataset_reader import DatasetReader
from deux.geometry.scaffolding import interpolate
from deux.io.images import read_depth
from deux.metrics.point_conditions import PointCondition, errors_under


class Watched(DepthModel):
    """Interpolates the points, and keeps what it was given."""

    min_depth, max_depth = 0.1, 10.0

    def __init__(self) -> None:
        super().__init__()
        self.scale = nn.Parameter(torch.ones(()))
        self.seen: list[np.ndarray] = []

    def forward(
        self, image: Tensor, sparse_depth: Tensor, validity: Tensor, intrinsics: Tensor, **prepared: Tensor
    ) -> Prediction:
        self.seen += list(sparse_depth[:, 0].numpy())
        depth = [torch.from_numpy(interpolate(one)) for one in sparse_depth[:, 0].numpy()]
        return Prediction(self.scale * torch.stack(depth)[:, None])


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return written(tmp_path_factory.mktemp("conditions") / "toy", split="test")


def test_the_points_are_those_of_the_condition(folder: Path) -> None:
    model, reader = Watched(), DatasetReader(folder)
    found = errors_under(PointCondition("uniform", 0.05), model, reader)
    assert found.images == len(model.seen) == len(reader.triplets("test", (-1, -2)))
    for sparse in model.seen:
        assert np.count_nonzero(sparse) == round(0.05 * sparse.size)
    assert found.metrics == pytest.approx(found.baseline, rel=1e-5)  # the model is the baseline


def test_more_points_and_less_noise_leave_less_error(folder: Path) -> None:
    reader = DatasetReader(folder)
    many, few, noisy = (
        errors_under(condition, Watched(), reader).metrics["mae"]
        for condition in (
            PointCondition("uniform", 0.1),
            PointCondition("uniform", 0.01),
            PointCondition("uniform", 0.1, noise=0.1),
        )
    )
    assert many < few
    assert many < noisy


def test_every_model_is_given_the_same_points(folder: Path) -> None:
    first, second = Watched(), Watched()
    condition = PointCondition("clusters", 0.02, noise=0.03, outliers=0.05)
    for model in (first, second):
        errors_under(condition, model, DatasetReader(folder), frames=3)
    assert len(first.seen) == 3
    np.testing.assert_array_equal(first.seen, second.seen)


def test_frames_are_spread_over_the_split(folder: Path) -> None:
    model, reader = Watched(), DatasetReader(folder)
    errors_under(PointCondition("uniform", 1.0), model, reader, frames=2)
    triplets = reader.triplets("test", (-1, -2))
    for sparse, place in zip(model.seen, (0, len(triplets) // 2), strict=True):
        target = triplets[place].target
        truth = read_depth(folder / "data" / target.sequence / "ground_truth" / f"{target.name}.png")
        np.testing.assert_array_equal(sparse, truth)
