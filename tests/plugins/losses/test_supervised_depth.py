import pytest
import torch

from deux.contracts import LossTerm, Prediction
from deux.errors import DeuxError
from deux.testing.losses import LossTermSuite, perfect_sample
from deux_plugins.losses.supervised_depth import SupervisedDepth


class TestSupervisedDepth(LossTermSuite):
    def make_term(self) -> LossTerm:
        return SupervisedDepth()


class TestCounted(LossTermSuite):
    def make_term(self) -> LossTerm:
        return SupervisedDepth(divisor="counted")


def test_agrees_with_the_published_value(published_case):
    batch, prediction, reconstructions, losses = published_case("scaffnet")
    value = SupervisedDepth()(batch, prediction, reconstructions)
    assert float(value) == pytest.approx(losses["supervised"], rel=1e-4)


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ({}, ((0.5 + 0.7) * 0.25 + 3.0 * 0.5) / 2),
        ({"divisor": "counted"}, ((0.5 + 0.7) / 2 + 3.0) / 2),
        ({"max_depth": 5.0}, ((0.5 + 0.4) * 0.25 + 3.0 * 0.5) / 2),
        ({"max_depth": 40.0}, ((0.5 + 0.85) * 0.25 + 3.0 * 0.5) / 2),
    ],
)
def test_which_pixels_count_and_how_far_the_truth_goes(options, expected):
    """Half of each frame has ground truth: 2 and 20 m in the first one, 0.75 m in the second; 3 m are predicted."""
    batch = perfect_sample(2).batch
    batch.ground_truth = torch.zeros(2, 1, 24, 32)
    batch.ground_truth[0, ..., :8], batch.ground_truth[0, ..., 8:16] = 2.0, 20.0
    batch.ground_truth[1, ..., :16] = 0.75
    value = SupervisedDepth(**options)(batch, Prediction(torch.full((2, 1, 24, 32), 3.0)), None)
    assert float(value) == pytest.approx(expected, rel=1e-5)


@pytest.mark.parametrize("divisor", ["image", "counted"])
def test_frames_without_ground_truth_cost_nothing(divisor):
    batch = perfect_sample(2).batch
    batch.ground_truth = torch.zeros(2, 1, 24, 32)
    depth = torch.full((2, 1, 24, 32), 3.0, requires_grad=True)
    value = SupervisedDepth(divisor=divisor)(batch, Prediction(depth), None)
    assert value.item() == 0.0
    assert not torch.autograd.grad(value, depth)[0].any()


@pytest.mark.parametrize("max_depth", [0.0, -1.0, float("nan")])
def test_the_farthest_depth_is_above_zero(max_depth):
    with pytest.raises(DeuxError, match=r"supervised_depth's max_depth is .*: it must be above 0"):
        SupervisedDepth(max_depth=max_depth)
