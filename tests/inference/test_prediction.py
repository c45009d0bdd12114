import numpy as np
import pytest
import torch
from torch.overrides import TorchFunctionMode

from deux.contracts import DepthModel, Prediction
from deux.errors import DeuxError
from deux.inference.prediction import predict, prepare_sample
from deux.testing.depth_models import camera_data


class Recorder(DepthModel):
    """Keeps what it was called with; predicts the pixel's column, in metres."""

    min_depth = 0.1
    max_depth = 100.0
    size_multiple = 16

    def prepare(self, sparse_depth):
        return {"doubled": 2 * sparse_depth[None]}

    def forward(self, image, sparse_depth, validity, intrinsics, **prepared):
        self.seen = {"image": image, "sparse_depth": sparse_depth, "validity": validity, **prepared}
        columns = torch.arange(image.shape[3], dtype=torch.float64)
        return Prediction(columns.expand(len(image), 1, *image.shape[2:]))


def test_pads_to_the_multiple_and_crops():
    model, data = Recorder(), camera_data((20, 40))
    depth = predict(model, **data)
    assert depth.shape == (2, 1, 20, 40)
    assert depth.dtype == torch.float32
    assert torch.equal(depth[0, 0, 0], torch.arange(40.0))
    for value in model.seen.values():
        assert value.shape[2:] == (32, 48)
        assert not value[:, :, 20:].any()
        assert not value[:, :, :, 40:].any()
    assert torch.equal(model.seen["doubled"], 2 * model.seen["sparse_depth"])


def test_outliers_lose_their_validity_but_stay_in_the_sparse_depth():
    model, data = Recorder(), camera_data((16, 16), points=0.0)
    data["sparse_depth"][:, :, 8, 8], data["sparse_depth"][:, :, 8, 9] = 2.0, 6.0
    predict(model, **data)
    assert model.seen["validity"].sum() == 2
    assert torch.equal(model.seen["sparse_depth"], data["sparse_depth"])


def test_takes_arrays_of_any_precision():
    data = {name: value.numpy().astype(np.float64) for name, value in camera_data((16, 16)).items()}
    assert predict(Recorder(), **data).shape == (2, 1, 16, 16)


def test_takes_arrays_with_reversed_axes_and_the_other_order_of_bytes():
    data = {name: value.numpy() for name, value in camera_data((16, 16)).items()}
    model, reversed_image = Recorder(), data["image"][:, ::-1]
    swapped = data["sparse_depth"].astype(data["sparse_depth"].dtype.newbyteorder())
    predict(model, reversed_image, swapped, data["intrinsics"])
    np.testing.assert_array_equal(model.seen["image"].numpy(), reversed_image)
    np.testing.assert_array_equal(model.seen["sparse_depth"].numpy(), data["sparse_depth"])


@pytest.mark.parametrize("value", [None, "picture.png"])
def test_what_holds_no_numbers_is_refused(value):
    with pytest.raises(DeuxError, match=r"^image is of the type \w+: it is a tensor or array of numbers\.$"):
        predict(Recorder(), **camera_data((16, 16)) | {"image": value})


@pytest.mark.parametrize("kind", [torch.float64, torch.float16, torch.bfloat16])
def test_weights_of_another_type_are_refused_in_a_sentence(kind):
    class Weighted(Recorder):
        def __init__(self):
            super().__init__()
            self.layer = torch.nn.Conv2d(3, 1, 1)

        def forward(self, image, *inputs, **prepared):
            self.layer(image)
            return super().forward(image, *inputs, **prepared)

    assert predict(Weighted(), **camera_data((16, 16))).dtype == torch.float32
    with pytest.raises(DeuxError, match=f"^the model's weights are of the type {str(kind)[6:]}, .* model.float"):
        predict(Weighted().to(kind), **camera_data((16, 16)))


@pytest.mark.parametrize(
    ("name", "change", "message"),
    [
        ("image", lambda x: x[0], "image has the shape 3 x 16 x 16"),
        ("image", lambda x: 255 * x, r"its values lie in \[0, 1\]"),
        ("image", lambda x: x * torch.nan, "image goes from nan"),
        ("sparse_depth", lambda x: x[:, 0], "sparse_depth has the shape 2 x 16 x 16: .* 2 x 1 x 16 x 16"),
        ("sparse_depth", lambda x: -x, "sparse_depth goes from -"),
        ("sparse_depth", lambda x: x / 0, "sparse_depth goes from"),
        ("intrinsics", lambda x: x[0], "intrinsics has the shape 3 x 3: .* 2 x 3 x 3"),
        ("intrinsics", torch.zeros_like, r"intrinsics\[0\] = .* is singular"),
        ("intrinsics", lambda x: x.transpose(1, 2), "no camera matrix"),
        ("intrinsics", lambda x: x * torch.nan, "no camera matrix"),
    ],
)
def test_impossible_inputs_are_refused(name, change, message):
    data = camera_data((16, 16), points=0.5)
    data[name] = change(data[name])
    with pytest.raises(DeuxError, match=message):
        predict(Recorder(), **data)


def test_mode_comes_back_after_an_error():
    class Failing(Recorder):
        def forward(self, image, sparse_depth, validity, intrinsics, **prepared):
            assert not self.training
            raise RuntimeError("failed")

    model = Failing().train()
    with pytest.raises(RuntimeError, match="failed"):
        predict(model, **camera_data((16, 16)))
    assert model.training


class Unprepared(Recorder):
    prepare = DepthModel.prepare


@pytest.mark.parametrize(("kind", "copies"), [(Unprepared, 0), (Recorder, 1)])
def test_values_are_read_once_and_points_copied_only_for_models_that_prepare(kind, copies):
    reads = []

    class Noted(TorchFunctionMode):
        def __torch_function__(self, func, types, args=(), kwargs=None):
            reads.append(func)
            return func(*args, **(kwargs or {}))

    model, data = kind(), camera_data((16, 16), points=0.5)
    with Noted():
        model.predict(**data)
    assert model.prepares == bool(copies)
    assert reads.count(torch.Tensor.tolist) == 1
    assert reads.count(torch.Tensor.numpy) == copies
    assert not {torch.Tensor.item, torch.Tensor.__bool__, torch.Tensor.__float__} & {*reads}


@pytest.mark.parametrize(
    ("output", "message"),
    [
        (lambda depth: depth, "Tensor of 2 x 1 x 32 x 32, float32: it must be a deux"),
        (lambda depth: None, "None: it must be"),
        (
            lambda depth: Prediction(depth[:, 0]),
            "a prediction whose depth is Tensor of 2 x 32 x 32, float32: .* here 2 x 1 ",
        ),
        (lambda depth: Prediction(depth[..., :-1]), "a prediction whose depth is Tensor of 2 x 1 x 32 x 31, float32"),
        (lambda depth: Prediction(depth.long()), "a prediction whose depth is Tensor of 2 x 1 x 32 x 32, int64"),
    ],
)
def test_an_output_that_is_no_depth_of_the_images_size_is_reported(output, message):
    class Odd(Recorder):
        def forward(self, image, sparse_depth, validity, intrinsics, **prepared):
            return output(sparse_depth)

    with pytest.raises(DeuxError, match=f"^the `forward` of .*Odd gives {message}"):
        predict(Odd(), **camera_data((20, 20)))


@pytest.mark.parametrize(
    ("prepared", "message"),
    [
        (np.ones((4, 5), np.float32), "gives ndarray of 4 x 5, float32: it must be arrays of C x H x W"),
        ({"a": np.ones((4, 5), np.float32)}, "gives ndarray of 4 x 5, float32 as 'a'"),
        ({"a": np.ones((1, 4, 5))}, "gives ndarray of 1 x 4 x 5, float64 as 'a'"),
        ({"a": np.ones((1, 5, 4), np.float32)}, "gives ndarray of 1 x 5 x 4, float32 as 'a'"),
        ({"a": torch.ones(1, 4, 5)}, "gives Tensor of 1 x 4 x 5, float32 as 'a'"),
    ],
)
def test_inputs_that_are_prepared_in_another_shape_or_type_are_reported(prepared, message):
    class Odd(Recorder):
        def prepare(self, sparse_depth):
            return prepared

    with pytest.raises(DeuxError, match=rf"^the `prepare` of .*Odd {message}"):
        prepare_sample(Odd().prepare, np.zeros((4, 5), np.float32))
