"""Models that cannot be exported, and what exporting leaves as it was."""

import logging
import warnings

import onnxruntime
import pytest
import torch

from deux.contracts import DepthModel, Prediction
from deux.deployment.onnx_export import export_onnx, random_inputs
from deux.errors import DeuxError


class Padded(DepthModel):
    """Convolves, at multiples of 16 pixels; what the padding holds shows at the border."""

    min_depth = 0.1
    max_depth = 10.0
    size_multiple = 16

    def __init__(self) -> None:
        super().__init__()
        self.convolution = torch.nn.Conv2d(5, 1, 3, padding=1)
        self.dropout = torch.nn.Dropout()

    def prepare(self, sparse_depth):
        return {"ones": (sparse_depth >= 0).astype("float32")[None]}

    def forward(self, image, sparse_depth, validity, intrinsics, **prepared):
        assert image.shape[2] % 16 == image.shape[3] % 16 == 0
        features = torch.cat([image, validity, prepared["ones"]], dim=1)
        return Prediction(1 + self.dropout(self.convolution(features)).abs() + sparse_depth)


class Branching(Padded):
    """Takes a path that depends on the values."""

    def forward(self, image, sparse_depth, validity, intrinsics, **prepared):
        if image.sum() > 0:
            return super().forward(image, sparse_depth, validity, intrinsics, **prepared)
        return Prediction(sparse_depth)


class Random(Padded):
    """Is another model at every call."""

    def forward(self, image, sparse_depth, validity, intrinsics, **prepared):
        return Prediction(1 + torch.rand_like(sparse_depth))


class Unknown(Padded):
    """Has no number for its depth."""

    def forward(self, image, sparse_depth, validity, intrinsics, **prepared):
        return Prediction(sparse_depth / sparse_depth)


def test_padding_and_outlier_removal_are_inside():
    model = Padded()
    exported = export_onnx(model, 21, 35)
    assert exported.difference < 1e-5
    assert exported.inputs["ones"] == ("N", 1, 21, 35)
    data = random_inputs(model, 2, 21, 35)
    (depth,) = onnxruntime.InferenceSession(exported.content).run(None, {k: v.numpy() for k, v in data.items()})
    expected = model.eval().predict(data["image"], data["sparse_depth"], data["intrinsics"])
    torch.testing.assert_close(torch.from_numpy(depth), expected)


def test_mode_warnings_and_logging_are_as_before():
    model = Padded().train()
    filters = list(warnings.filters)
    export_onnx(model, 16, 16, batch=1)
    assert model.training
    assert model.dropout.training
    assert warnings.filters == filters
    assert logging.root.manager.disable == logging.NOTSET


@pytest.mark.parametrize(
    ("model", "reason"),
    [
        (Branching, "Branching cannot be exported as ONNX: .*data-dependent"),
        (
            Random,
            r"Random cannot be exported as ONNX: the exported model's depth differs by up to \d+\.\d\d% from PyTor",
        ),
        (
            Unknown,
            "Unknown cannot be exported as ONNX: the exported model's depth differs by up to nan% from PyTorch's",
        ),
    ],
)
def test_what_cannot_be_exported_is_reported_in_one_sentence(model, reason):
    with pytest.raises(DeuxError, match=f"^{reason}") as caught:
        export_onnx(model(), 16, 16)
    assert "\n" not in str(caught.value)
    assert logging.root.manager.disable == logging.NOTSET
