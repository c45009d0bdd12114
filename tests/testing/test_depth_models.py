"""The suite must pass a sound model and catch each fault that it is there to catch."""

from typing import Any, ClassVar

import pytest
import torch
from torch import Tensor, nn

from deux.contracts import DepthModel, LossSettings, Prediction
from deux.errors import DeuxError
from deux.testing.depth_models import DepthModelSuite


class Sound(DepthModel):
    """Depth from image and points by three convolutions."""

    min_depth, max_depth = 0.1, 10.0
    objective: ClassVar[LossSettings] = {"color_consistency": 0.2, "sparse_depth": 1.0}

    def __init__(self) -> None:
        super().__init__()
        self.network = nn.Sequential(nn.Conv2d(5, 4, 3, padding=1), nn.ELU(), nn.Conv2d(4, 1, 3, padding=1))

    def features(self, *inputs: Tensor) -> Tensor:
        return self.network(torch.cat(inputs, dim=1)).float()

    def forward(
        self, image: Tensor, sparse_depth: Tensor, validity: Tensor, intrinsics: Tensor, **prepared: Tensor
    ) -> Any:
        share = torch.sigmoid(self.features(image, sparse_depth, validity))
        return Prediction(self.min_depth + (self.max_depth - self.min_depth) * share)


class ReturnsTheDepth(Sound):
    def forward(self, image, sparse_depth, validity, intrinsics, **prepared):
        return super().forward(image, sparse_depth, validity, intrinsics).depth


class Changed(Sound):
    """The depth of `Sound`, changed by `change`."""

    def forward(self, image, sparse_depth, validity, intrinsics, **prepared):
        return Prediction(self.change(super().forward(image, sparse_depth, validity, intrinsics).depth))


class IsNaN(Changed):
    def change(self, depth):
        return depth * torch.nan


class IsNegative(Changed):
    def change(self, depth):
        return -depth


class IsInMillimetres(Changed):
    def change(self, depth):
        return 1000.0 * depth


class LacksTheChannel(Changed):
    def change(self, depth):
        return depth[:, 0]


class IsHalf(Changed):
    def change(self, depth):
        return depth.half()


class DrawsByLot(Changed):
    def change(self, depth):
        return depth * (0.9 + 0.1 * torch.rand_like(depth))


class IsNormalisedOverTheBatch(Changed):
    def change(self, depth):
        return (depth / depth.mean()).clamp(self.min_depth, self.max_depth)


class RangeInMillimetres(Sound):
    min_depth, max_depth = 100.0, 10000.0


class Remembers(Changed):
    """A hidden state from frame to frame."""

    hidden = None

    def change(self, depth):
        mixed = depth if self.hidden is None else 0.5 * depth + 0.5 * self.hidden
        self.hidden = depth.detach()
        return mixed


class ChangesTheValidity(Sound):
    def forward(self, image, sparse_depth, validity, intrinsics, **prepared):
        prediction = super().forward(image, sparse_depth, validity, intrinsics)
        validity.zero_()
        return prediction


class KeepsAPlainTensor(Changed):
    def __init__(self):
        super().__init__()
        self.scale = torch.full((1, 1, 1, 1), 0.99)

    def change(self, depth):
        return depth * self.scale + (1 - self.scale)


class WithoutWeights(Changed):
    def change(self, depth):
        return torch.ones_like(depth) + 0.0 * depth


class UnknownTerm(Sound):
    objective: ClassVar[LossSettings] = {"colour_consistency": 0.2}


class UnknownExtra(Sound):
    objective: ClassVar[LossSettings] = {"topology_prior": 0.2}


class TakesTheTruth(Sound):
    def forward(self, image, sparse_depth, validity, intrinsics, ground_truth=None):
        return super().forward(image, sparse_depth, validity, intrinsics)


FAULTS = [
    (ReturnsTheDepth, "predicts_depth_within_the_range", r"`forward` gives Tensor of .*, not a Prediction"),
    (IsNaN, "predicts_depth_within_the_range", "NaN or infinite in some pixels"),
    (IsNegative, "predicts_depth_within_the_range", "goes from -.* m, outside of the declared range: min_depth is 0.1"),
    (IsInMillimetres, "predicts_depth_within_the_range", "outside of the declared range: max_depth is 10"),
    (LacksTheChannel, "predicts_depth_within_the_range", "Tensor of 2 x 64 x 96, float32, not N x 1 x H x W"),
    (IsHalf, "predicts_depth_within_the_range", "float16, not float32"),
    (
        RangeInMillimetres,
        "range_is_declared",
        "min_depth = 100 to max_depth = 10000 leaves out .*: the range is in met",
    ),
    (DrawsByLot, "same_inputs_give_the_same_depth", "predictions are not deterministic"),
    (Remembers, "same_inputs_give_the_same_depth", "after another frame, .* keeps nothing from one call to the next"),
    (IsNormalisedOverTheBatch, "samples_do_not_influence_each_other", "not close"),
    (ChangesTheValidity, "inputs_are_left_as_they_were", "`forward` changed its inputs: validity"),
    (KeepsAPlainTensor, "all_its_tensors_move_to_a_device", r"^scale: model\.to\(device\) would not move"),
    (WithoutWeights, "every_trainable_parameter_gets_a_gradient", r"no gradient reaches network\.0\.weight"),
    (WithoutWeights, "state_fills_another_model", "does not depend on them"),
    (UnknownTerm, "its_objective_can_be_computed", "no loss term called 'colour_consistency': did you mean color_cons"),
    (UnknownExtra, "its_objective_can_be_computed", "needs the extra 'prior' of the prediction"),
    (TakesTheTruth, "forward_takes_no_ground_truth", r"takes \['ground_truth'\], which `prepare` does not return"),
]


def suite_of(model_class: type[DepthModel]) -> DepthModelSuite:
    suite = DepthModelSuite()
    suite.make_model = model_class  # type: ignore[method-assign]
    return suite


class TestSound(DepthModelSuite):
    def make_model(self) -> DepthModel:
        return Sound()


@pytest.mark.parametrize(("faulty", "test", "sentence"), FAULTS)
def test_each_fault_is_named_by_the_test_for_it(faulty: type[DepthModel], test: str, sentence: str) -> None:
    torch.manual_seed(0)
    model = faulty().eval()
    with pytest.raises((AssertionError, DeuxError), match=sentence):
        getattr(suite_of(faulty), f"test_{test}")(model)
