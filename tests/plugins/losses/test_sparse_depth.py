import pytest
import torch

from deux.contracts import LossInputs, LossTerm, Prediction
from deux.testing.losses import DEPTH_RANGE, LossTermSuite, perfect_sample
from deux_plugins.losses.sparse_depth import SparseDepth


class TestSparseDepth(LossTermSuite):
    def make_term(self) -> LossTerm:
        return SparseDepth()


@pytest.mark.parametrize("name", ["kbnet", "voiced", "fusionnet"])
def test_agrees_with_the_published_value(published_case, name):
    inputs, losses = published_case(name)
    value = SparseDepth()(inputs)
    assert float(value) == pytest.approx(losses["sparse_depth"], rel=1e-4)


def test_each_frame_counts_alike_and_only_its_valid_points():
    batch = perfect_sample(2).batch
    batch.sparse_depth.zero_()
    batch.validity.zero_()
    batch.sparse_depth[0, 0, 0, :3] = torch.tensor([1.0, 2.0, 9.0])
    batch.validity[0, 0, 0, :2] = 1.0  # the third point is an outlier
    batch.sparse_depth[1, 0, 5, 5], batch.validity[1, 0, 5, 5] = 4.0, 1.0
    prediction = Prediction(torch.full((2, 1, 24, 32), 2.0))
    value = SparseDepth()(LossInputs(batch, prediction, None, DEPTH_RANGE))
    assert float(value) == pytest.approx(((1.0 + 0.0) / 2 + 2.0) / 2)
