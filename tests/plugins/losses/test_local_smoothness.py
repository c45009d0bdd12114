import math

import pytest
import torch

from deux.contracts import LossInputs, LossTerm, Prediction
from deux.testing.losses import DEPTH_RANGE, LossTermSuite, perfect_sample
from deux_plugins.losses.local_smoothness import LocalSmoothness


class TestLocalSmoothness(LossTermSuite):
    def make_term(self) -> LossTerm:
        return LocalSmoothness()


@pytest.mark.parametrize("name", ["kbnet", "voiced", "fusionnet"])
def test_agrees_with_the_published_value(published_case, name):
    inputs, losses = published_case(name)
    value = LocalSmoothness()(inputs)
    assert float(value) == pytest.approx(losses["smoothness"], rel=1e-4)


def test_a_depth_edge_costs_less_on_a_colour_edge():
    batch = perfect_sample(1).batch
    depth = torch.full((1, 1, 24, 32), 2.0)
    depth[..., 16:] = 5.0
    batch.image = torch.zeros(1, 3, 24, 32)
    flat = float(LocalSmoothness()(LossInputs(batch, Prediction(depth), None, DEPTH_RANGE)))
    batch.image[..., 16:] = 0.8
    edge = float(LocalSmoothness()(LossInputs(batch, Prediction(depth), None, DEPTH_RANGE)))
    assert flat == pytest.approx(3.0 / 31)
    assert edge == pytest.approx(flat * math.exp(-0.8), rel=1e-5)
