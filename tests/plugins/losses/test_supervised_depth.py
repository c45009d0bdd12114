import pytest
import torch

from deux.contracts import LossInputs, LossTerm, Prediction
from deux.testing.losses import DEPTH_RANGE, LossTermSuite, perfect_sample
from deux_plugins.losses.supervised_depth import SupervisedDepth


class TestSupervisedDepth(LossTermSuite):
    def make_term(self) -> LossTerm:
        return SupervisedDepth()


class TestCounted(LossTermSuite):
    def make_term(self) -> LossTerm:
        return SupervisedDepth(divisor="counted")


def test_agrees_with_the_published_value(published_case):
    inputs, losses = published_case("scaffnet")
    value = SupervisedDepth()(inputs)
    assert float(value) == pytest.approx(losses["supervised"], rel=1e-4)


@pytest.mark.parametrize(
    ("options", "max_depth", "expected"),
    [
        ({}, 10.0, ((0.5 + 0.7) * 0.25 + 3.0 * 0.5) / 2),
        ({"divisor": "counted"}, 10.0, ((0.5 + 0.7) / 2 + 3.0) / 2),
        ({}, 5.0, ((0.5 + 0.4) * 0.25 + 3.0 * 0.5) / 2),
        ({}, 80.0, ((0.5 + 0.85) * 0.25 + 3.0 * 0.5) / 2),
    ],
)
def test_which_pixels_count_and_how_far_the_truth_goes(options, max_depth, expected):
    """Half of each frame has ground truth: 2 and 20 m in the first one, 0.75 m in the second; 3 m are predicted."""
    batch = perfect_sample(2).batch
    batch.ground_truth = torch.zeros(2, 1, 24, 32)
    batch.ground_truth[0, ..., :8], batch.ground_truth[0, ..., 8:16] = 2.0, 20.0
    batch.ground_truth[1, ..., :16] = 0.75
    prediction = Prediction(torch.full((2, 1, 24, 32), 3.0))
    value = SupervisedDepth(**options)(LossInputs(batch, prediction, None, (0.1, max_depth)))
    assert float(value) == pytest.approx(expected, rel=1e-5)


@pytest.mark.parametrize("divisor", ["image", "counted"])
def test_frames_without_ground_truth_cost_nothing(divisor):
    batch = perfect_sample(2).batch
    batch.ground_truth = torch.zeros(2, 1, 24, 32)
    depth = torch.full((2, 1, 24, 32), 3.0, requires_grad=True)
    value = SupervisedDepth(divisor=divisor)(LossInputs(batch, Prediction(depth), None, DEPTH_RANGE))
    assert value.item() == 0.0
    assert not torch.autograd.grad(value, depth)[0].any()
