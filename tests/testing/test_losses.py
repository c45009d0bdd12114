"""The suite must fail for terms that break the contract, each in the test that is meant for it."""

import pytest
import torch

from deux.contracts import LossInputs, LossNeed, LossTerm
from deux.testing.losses import LossTermSuite


class BrokenTerm(LossTerm):
    """Mean error at the points, with one thing wrong."""

    def __init__(self, fault: str) -> None:
        self.fault = fault
        self.needs = frozenset({"points"} if fault == "unknown need" else set())

        self.extras = "prior" if self.fault == "extras as text" else frozenset()

    def __call__(self, inputs: LossInputs) -> torch.Tensor:
        batch = inputs.batch
        if self.fault == "changes its inputs":
            batch.sparse_depth.clamp_(max=1.0)
        depth = inputs.prediction.depth
        if self.fault == "computes in bfloat16":
            depth = depth.bfloat16()
        if self.fault == "judges the rounding":
            return (depth - depth.bfloat16().float()).abs().mean()
        difference = (depth - batch.sparse_depth.to(depth.dtype)).abs() * batch.validity.to(depth.dtype)
        if self.fault == "reads values" and difference.sum().item() == 0.0:
            return (inputs.prediction.depth * 0.0).sum()
        if self.fault == "sums over the batch":
            return difference.sum() / 1000.0
        if self.fault == "judges the motion":
            return batch.source_from_target[..., :3, 3].square().mean()
        if self.fault == "no scalar":
            return difference.mean(dim=(1, 2, 3))
        if self.fault == "no gradient":
            return difference.detach().mean()
        if self.fault == "never zero":
            return difference.mean() + 1.0
        count = batch.validity.sum()
        count = count if self.fault == "divides by zero" else count.clamp(min=1)
        return (difference.sum() / count).to(depth.dtype)


def run(fault: str, test: str) -> None:
    suite = LossTermSuite()
    suite.make_term = lambda: BrokenTerm(fault)
    getattr(suite, test)()


TESTS = [name for name in dir(LossTermSuite) if name.startswith("test_")]


@pytest.mark.parametrize("test", TESTS)
def test_a_sound_term_passes(test):
    run("none", test)


@pytest.mark.parametrize(
    ("fault", "test"),
    [
        ("unknown need", "test_declares_known_needs"),
        ("extras as text", "test_declares_known_needs"),
        ("no scalar", "test_is_a_finite_float32_scalar"),
        ("never zero", "test_is_zero_at_perfection_only"),
        ("no gradient", "test_is_differentiable"),
        ("judges the motion", "test_is_differentiable"),
        ("divides by zero", "test_frames_without_points"),
        ("reads values", "test_keeps_a_card_busy"),
        ("sums over the batch", "test_is_a_mean_over_the_batch"),
        ("changes its inputs", "test_leaves_its_inputs_alone"),
        ("computes in bfloat16", "test_is_a_finite_float32_scalar"),
        ("judges the rounding", "test_rounded_predictions_hardly_change_it"),
    ],
)
def test_a_broken_term_fails(fault, test):
    with pytest.raises(AssertionError):
        run(fault, test)


def test_a_term_that_takes_the_prediction_for_float32_passes():
    """The contract says that it is, and the objective converts it."""

    class Trusting(LossTerm):
        def __call__(self, inputs: LossInputs) -> torch.Tensor:
            points = inputs.batch.sparse_depth
            error = torch.nn.functional.huber_loss(inputs.prediction.depth, points, reduction="none")
            return (error * inputs.batch.validity).sum() / inputs.batch.validity.sum().clamp(min=1)

    for test in TESTS:
        suite = LossTermSuite()
        suite.make_term = Trusting
        getattr(suite, test)()


def test_a_term_gets_only_what_it_declares():
    class Curious(BrokenTerm):
        def __call__(self, inputs):
            assert (inputs.batch.ground_truth is None) == (LossNeed.GROUND_TRUTH not in self.needs)
            assert (inputs.reconstructions is None) == (LossNeed.RECONSTRUCTIONS not in self.needs)
            assert set(inputs.prediction.extras) == self.extras
            assert inputs.depth_range == (0.1, 10.0)
            return super().__call__(inputs)

    for needs, extras in (
        (set(), set()),
        ({LossNeed.GROUND_TRUTH}, set()),
        ({LossNeed.RECONSTRUCTIONS}, {"prior"}),
        (set(), {"variance", "normals"}),
    ):
        term = Curious("none")
        term.needs, term.extras = frozenset(needs), frozenset(extras)
        suite = LossTermSuite()
        suite.make_term = lambda term=term: term
        suite.test_is_a_finite_float32_scalar()


class LogVariance(LossTerm):
    """Laplace likelihood |d - g| exp(-s) + s at the points, with the logarithm s of the scale as an extra."""

    needs = frozenset({LossNeed.GROUND_TRUTH})
    extras = frozenset({"log_scale"})

    def __call__(self, inputs: LossInputs) -> torch.Tensor:
        scale = inputs.prediction.extras["log_scale"].float()
        error = (inputs.prediction.depth.float() - inputs.batch.ground_truth).abs()
        return (error * (-scale).exp() + scale).mean()


class TestAnUnusualExtra(LossTermSuite):
    """The suite with an extra that is no depth."""

    def make_term(self):
        return LogVariance()

    def make_extra(self, name, sample):
        assert name == "log_scale"
        return torch.zeros_like(sample.depth)


class DetachedDepth(LogVariance):
    """Teaches the extra alone."""

    def __call__(self, inputs):
        return super().__call__(
            LossInputs(
                inputs.batch,
                type(inputs.prediction)(inputs.prediction.depth.detach(), inputs.prediction.extras),
                inputs.reconstructions,
                inputs.depth_range,
            )
        )


class TestATermForAnExtraAlone(TestAnUnusualExtra):
    def make_term(self):
        return DetachedDepth()


@pytest.mark.parametrize("test", ["is_a_finite_float32_scalar", "is_differentiable", "frames_without_points"])
def test_a_number_in_place_of_a_tensor_is_named_in_the_failure(test):
    class Number(BrokenTerm):
        def __call__(self, inputs):
            return float(super().__call__(inputs).detach())

    suite = LossTermSuite()
    suite.make_term = lambda: Number("none")
    with pytest.raises(AssertionError, match="the value is a value of the type float, not a Tensor"):
        getattr(suite, f"test_{test}")()
