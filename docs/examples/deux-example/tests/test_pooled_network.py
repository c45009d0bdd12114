import torch

from deux.contracts import DepthModel
from deux.testing.depth_models import DepthModelSuite
from deux_example.pooled_network import PooledNetwork, fill


class TestPooledNetwork(DepthModelSuite):
    def make_model(self) -> DepthModel:
        return PooledNetwork(channels=4)


def test_fill_keeps_lone_points_and_spreads_them() -> None:
    sparse_depth = torch.zeros(1, 1, 16, 16)
    sparse_depth[0, 0, 2, 2], sparse_depth[0, 0, 13, 13] = 2.0, 4.0
    filled = fill(sparse_depth, (sparse_depth > 0).float())
    assert filled[0, 0, 2, 3] == 2.0
    assert filled[0, 0, 13, 12] == 4.0
    assert filled.min() >= 2.0


def test_fill_without_points_is_one_metre() -> None:
    assert torch.equal(fill(torch.zeros(1, 1, 8, 8), torch.zeros(1, 1, 8, 8)), torch.ones(1, 1, 8, 8))
