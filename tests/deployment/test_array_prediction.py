"""`deux.predict` against `DepthModel.predict`, and the mistakes that arrays invite."""

import numpy as np
import pytest
import torch
from PIL import Image

import deux
from deux.contracts import DepthModel, Prediction
from deux.deployment.model_files import save_model
from deux.errors import DeuxError
from deux.geometry.depth_correction import correct_depth
from deux.inference import prediction
from deux.registry import registry

SMALL = {"image_filters": (4, 8, 8, 8, 8), "depth_filters": (4, 4, 4, 4, 4), "decoder_filters": (8, 8, 8, 8, 4)}
HEIGHT, WIDTH = 37, 50


class Doubling(DepthModel):
    """Twice the sparse depth, plus the image's red, plus the focal length in thousands of pixels."""

    min_depth = 0.1
    max_depth = 10.0
    size_multiple = 16

    def forward(self, image, sparse_depth, validity, intrinsics, **prepared):
        assert image.dtype == sparse_depth.dtype == intrinsics.dtype == torch.float32
        assert not torch.is_autocast_enabled("cpu")
        return Prediction(2 * sparse_depth + image[:, :1] + intrinsics[:, 0, 0].view(-1, 1, 1, 1) / 1000)


@pytest.fixture(scope="module")
def model():
    torch.manual_seed(0)
    return registry().create("depth_models", "kbnet", SMALL).eval()


def frame(seed: int = 0) -> dict[str, np.ndarray]:
    """One frame: image H x W x 3 uint8, points at 5 % of the pixels, a camera of 90 degrees."""
    rng = np.random.default_rng(seed)
    points = rng.random((HEIGHT, WIDTH)) < 0.05
    return {
        "image": rng.integers(0, 256, (HEIGHT, WIDTH, 3), np.uint8),
        "sparse_depth": np.where(points, rng.uniform(1, 5, (HEIGHT, WIDTH)), 0.0),
        "intrinsics": np.array([[25.0, 0.0, 24.5], [0.0, 25.0, 18.0], [0.0, 0.0, 1.0]]),
    }


def test_the_formula_arrives_pixel_by_pixel():
    data = frame()
    depth = deux.predict(**data, model=Doubling())
    expected = 2 * data["sparse_depth"] + data["image"][..., 0] / 255 + 0.025
    assert (depth.shape, depth.dtype) == ((HEIGHT, WIDTH), np.float32)
    np.testing.assert_allclose(depth, expected, rtol=1e-6)


def test_a_frame_equals_the_tensors_prediction(model):
    data = frame()
    image = torch.from_numpy(data["image"]).permute(2, 0, 1)[None] / 255
    points, camera = (torch.from_numpy(data[name])[None].float() for name in ("sparse_depth", "intrinsics"))
    expected = model.predict(image, points[None], camera)
    np.testing.assert_array_equal(deux.predict(**data, model=model), expected[0, 0].numpy())


def test_colours_as_bytes_or_as_floats_are_the_same(model):
    data = frame()
    expected = deux.predict(**data, model=model)
    for dtype in (np.float32, np.float64):
        data["image"] = frame()["image"].astype(dtype) / dtype(255)
        np.testing.assert_allclose(deux.predict(**data, model=model), expected, rtol=1e-5)


def test_a_batch_is_its_frames(model):
    frames = [frame(seed) for seed in range(3)]
    batch = {name: np.stack([one[name] for one in frames]) for name in frames[0]}
    batch["intrinsics"][1, 0, 0] = frames[1]["intrinsics"][0, 0] = 30.0
    depth = deux.predict(**batch, model=model)
    assert depth.shape == (3, HEIGHT, WIDTH)
    for one, alone in zip(depth, frames, strict=True):
        np.testing.assert_allclose(one, deux.predict(**alone, model=model), rtol=1e-4)


def test_the_depth_corrected_by_the_points(model):
    data = frame()
    plain, points = (torch.from_numpy(x)[None, None] for x in (deux.predict(**data, model=model), data["sparse_depth"]))
    expected = correct_depth(plain, points)[0, 0].numpy()
    np.testing.assert_allclose(deux.predict(**data, model=model, corrected=True), expected, rtol=1e-5)
    streams = (iter([data["image"]] * 3), iter([data["sparse_depth"]] * 3))
    for depth in deux.predict(*streams, data["intrinsics"], model=model, batch_size=2, corrected=True):
        np.testing.assert_allclose(depth, expected, rtol=1e-4)
    given = data["sparse_depth"] > 0
    errors = [np.abs(depth - data["sparse_depth"])[given].mean() for depth in (plain[0, 0].numpy(), expected)]
    assert errors[1] < 0.5 * errors[0]


def test_a_batch_shares_one_camera(model):
    one = frame()
    batch = {name: np.stack([one[name], one[name]]) for name in ("image", "sparse_depth")}
    depth = deux.predict(**batch, intrinsics=one["intrinsics"], model=model)
    assert depth.shape == (2, HEIGHT, WIDTH)
    np.testing.assert_allclose(depth[0], depth[1], rtol=1e-5)


def test_arrays_of_any_make(model):
    """Views with negative strides, read-only memory, Pillow's images, lists, tensors; none of them is written to."""
    data = frame()
    expected = deux.predict(**data, model=model)
    mirrored = {"image": data["image"][..., ::-1].copy()[..., ::-1], "sparse_depth": data["sparse_depth"][::-1][::-1]}
    foreign = {"image": Image.fromarray(data["image"]), "sparse_depth": torch.from_numpy(data["sparse_depth"])}
    for arrays in (mirrored, foreign, {"intrinsics": data["intrinsics"].tolist()}):
        np.testing.assert_array_equal(deux.predict(**{**data, **arrays}, model=model), expected)
    for array in data.values():
        array.flags.writeable = False
    np.testing.assert_array_equal(deux.predict(**data, model=model), expected)
    assert all(np.array_equal(data[name], value) for name, value in frame().items())


def test_what_is_masked_is_no_point(model):
    """numpy drops a mask where an array is expected, and the model would be given what lies under it."""
    data = frame()
    masked = np.ma.masked_where(np.arange(WIDTH) % 2 * np.ones((HEIGHT, 1)) > 0, data["sparse_depth"])
    expected = deux.predict(**{**data, "sparse_depth": masked.filled(0)}, model=model)
    assert (expected != deux.predict(**data, model=model)).any()
    masked.data[masked.mask] = np.nan
    np.testing.assert_array_equal(deux.predict(**{**data, "sparse_depth": masked}, model=model), expected)
    batch = {"image": [data["image"]] * 2, "sparse_depth": [masked, masked.filled(0)]}
    for depth in deux.predict(**batch, intrinsics=data["intrinsics"], model=model):
        np.testing.assert_allclose(depth, expected, rtol=1e-5)
    unmasked = np.ma.masked_array(data["image"])
    deux.predict(**{**data, "image": unmasked}, model=model)


def test_half_precision_around_it_changes_nothing(model):
    expected = deux.predict(**frame(), model=model)
    with torch.autocast("cpu", torch.bfloat16):
        np.testing.assert_array_equal(deux.predict(**frame(), model=model), expected)
        deux.predict(**frame(), model=Doubling())


@pytest.mark.parametrize("dtype", [torch.float16, torch.bfloat16, torch.float64])
def test_weights_of_another_precision_are_reported(dtype):
    kind = str(dtype).removeprefix("torch.")
    model = registry().create("depth_models", "kbnet", {}).to(dtype)
    image, sparse_depth = np.zeros((32, 32, 3), np.uint8), np.full((32, 32), 2.0, np.float32)
    intrinsics = np.array([[20.0, 0.0, 15.5], [0.0, 20.0, 15.5], [0.0, 0.0, 1.0]])
    with pytest.raises(DeuxError, match=rf"weights are of the type {kind}, .*: call model\.float\(\)"):
        deux.predict(image, sparse_depth, intrinsics, model=model)


def test_a_path_is_a_model(model, tmp_path):
    save_model(tmp_path / "model.safetensors", model, "kbnet", SMALL)
    expected = deux.predict(**frame(), model=model)
    for path in (tmp_path, str(tmp_path), tmp_path / "model.safetensors"):
        np.testing.assert_array_equal(deux.predict(**frame(), model=path), expected)


@pytest.mark.parametrize("value", [float("nan"), float("inf")])
def test_a_prediction_that_is_no_number_is_an_error(value):
    class Broken(Doubling):
        def forward(self, *inputs, **prepared):
            depth = super().forward(*inputs, **prepared).depth.clone()
            depth[0, 0, 3, 4] = value
            return Prediction(depth)

    with pytest.raises(DeuxError, match="predicts NaN or infinity at 1 of 1,850 pixels"):
        deux.predict(**frame(), model=Broken())


@pytest.mark.parametrize("focus", [1e-30, 1e20])
def test_focal_lengths_of_no_camera_are_an_error(model, focus):
    given = frame()
    given["intrinsics"][0, 0] = focus
    with pytest.raises(DeuxError, match=r"intrinsics\[0\] has the focal lengths 1e[+-][0-9]+ and 25"):
        deux.predict(**given, model=model)


def test_an_image_for_which_there_is_no_memory_is_refused(monkeypatch, leave_memory):
    monkeypatch.setattr(prediction, "LARGE", 10)
    leave_memory(1000)
    with pytest.raises(DeuxError, match="the prediction of 1 x 50 x 37 pixels would take"):
        deux.predict(**frame(), model=Doubling())


def test_no_model(tmp_path):
    with pytest.raises(DeuxError, match=r"^there is no model .*/model\.safetensors: give a model file"):
        deux.predict(**frame(), model=tmp_path)
    with pytest.raises(DeuxError, match=r"^model is of the type NoneType: it is a depth model, or the path of a run"):
        deux.predict(**frame(), model=None)


def test_points_beyond_the_range_are_no_mistake_while_one_lies_within():
    data = frame()
    data["sparse_depth"] *= 9.0
    data["sparse_depth"][0, 0] = 9.9
    assert deux.predict(**data, model=Doubling()).max() > 80.0


def test_points_that_all_lie_beyond_the_range_are_refused():
    """In centimetres they are no farther away than ten times the model's range."""
    data = frame()
    data["sparse_depth"] *= 100.0
    sentence = r"sparse_depth is at 10.* predicts up to 10 metres: .* divide millimetres by 1000 and centimetres by 100"
    with pytest.raises(DeuxError, match=sentence):
        deux.predict(**data, model=Doubling())
    with pytest.raises(DeuxError, match=rf"^frame 0: .*{sentence}"):
        next(deux.predict(**{name: iter([value]) for name, value in data.items()}, model=Doubling()))


def test_a_later_frame_of_a_stream_may_be_far_away():
    near, far = frame(), frame()
    far["sparse_depth"] *= 15.0
    stream = {name: iter([near[name], far[name]]) for name in near}
    assert max(depth.max() for depth in deux.predict(**stream, model=Doubling())) > 100.0


def test_a_camera_of_another_size_is_warned_of_once_in_a_call_or_stream(caplog):
    data = frame()
    deux.predict(**data, model=Doubling())
    assert not caplog.messages
    data["intrinsics"] = np.diag([1 / WIDTH, 1 / HEIGHT, 1.0]) @ data["intrinsics"]
    deux.predict(**data, model=Doubling())
    (message,) = caplog.messages
    assert message.startswith("the focal lengths 0.5 and 0.675676 are too short for an image of 50 x 37 pixels: if the")
    assert message.endswith("multiply its first row by the width 50 and its second row by the height 37.")
    for given in (
        {name: np.stack([value] * 3) for name, value in data.items()},
        {name: iter([value] * 3) for name, value in data.items()},
    ):
        caplog.clear()
        assert len(list(deux.predict(**given, model=Doubling()))) == 3
        assert caplog.messages == [message]


def test_a_matrix_of_no_numbers_is_refused_and_not_judged(caplog):
    with pytest.raises(DeuxError, match="is singular or no camera matrix"):
        deux.predict(**frame() | {"intrinsics": np.full((3, 3), np.nan)}, model=Doubling())
    assert not caplog.messages


MISTAKES = {
    "grey": ("image", lambda x: x[..., 0], "image has the shape 37 x 50: it is H x W x 3 (red, green, blue), or N x"),
    "channels first": ("image", lambda x: x.transpose(2, 0, 1), "image has the shape 3 x 37 x 50: it is H x W x 3"),
    "alpha": ("image", lambda x: np.concatenate([x, x[..., :1]], 2), "image has the shape 37 x 50 x 4: it is H x W x"),
    "empty": ("image", lambda x: x[:0], "image has the shape 0 x 50 x 3: it is H x W x 3"),
    "scalar": ("image", lambda x: 0.5, "image has the shape a single number: it is H x W x 3"),
    "16 bits": ("image", lambda x: x.astype(np.uint16), "image is of the type uint16: it is uint8, or floating point"),
    "bytes as floats": ("image", lambda x: x.astype(float), "image goes from 0 to 255: its values lie in [0, 1]"),
    "not a number": ("image", lambda x: x * np.nan, "image goes from nan to nan: its values lie in [0, 1]"),
    "masked": (
        "image",
        lambda x: np.ma.masked_equal(x, x[0, 0, 0]),
        "image has masked values, which no model can be given: fill them, by .filled(0) or better.",
    ),
    "masked row": (
        "intrinsics",
        lambda x: [np.ma.masked_equal(row, 0.0) for row in x],
        "intrinsics has masked values, which no model can be given",
    ),
    "text": ("image", lambda x: "photo.png", "image is of the type <U9: it is an array of numbers."),
    "ragged": ("image", lambda x: [[1, 2], [3]], "image cannot be made an array (setting an array element"),
    "other size": (
        "sparse_depth",
        lambda x: x[1:],
        "sparse_depth has the shape 36 x 50: for an image of 37 x 50 x 3 it",
    ),
    "with channel": ("sparse_depth", lambda x: x[..., None], "sparse_depth has the shape 37 x 50 x 1: for an image of"),
    "batched": ("sparse_depth", lambda x: x[None], "sparse_depth has the shape 1 x 37 x 50: for an image of 37 x 50 x"),
    "integers": (
        "sparse_depth",
        lambda x: (1000 * x).astype(np.uint16),
        "sparse_depth is of the type uint16: it is met",
    ),
    "mask": ("sparse_depth", lambda x: x > 0, "sparse_depth is of the type bool: it is metres in floating point"),
    "millimetres": ("sparse_depth", lambda x: 1000 * x, "the nearest point of sparse_depth is at 10"),
    "negative": ("sparse_depth", lambda x: -x, "sparse_depth goes from -"),
    "unknown as nan": ("sparse_depth", lambda x: x / (x > 0), "sparse_depth goes from nan to nan: it is in metres, fi"),
    "too large": ("sparse_depth", lambda x: x * 1e300, "sparse_depth goes from 0 to inf: it is in metres, finite"),
    "4 x 4": (
        "intrinsics",
        lambda x: np.eye(4),
        "intrinsics has the shape 4 x 4: for an image of 37 x 50 x 3 it is 3 x 3.",
    ),
    "batched camera": ("intrinsics", lambda x: x[None], "intrinsics has the shape 1 x 3 x 3: for an image of 37 x 50 "),
    "singular": (
        "intrinsics",
        np.zeros_like,
        "intrinsics[0] = [[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]] is sing",
    ),
    "transposed": ("intrinsics", lambda x: x.T, "intrinsics[0] = "),
}


@pytest.mark.filterwarnings("ignore:invalid value encountered:RuntimeWarning")
@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistake_is_one_sentence(mistake):
    name, change, sentence = MISTAKES[mistake]
    data = frame()
    data[name] = change(data[name])
    with pytest.raises(DeuxError) as caught:
        deux.predict(**data, model=Doubling())
    assert str(caught.value).startswith(sentence)
    assert "\n" not in str(caught.value)


def test_a_camera_for_each_frame_or_one_for_all():
    data = {name: np.stack([value] * 2) for name, value in frame().items()}
    data["intrinsics"] = np.stack([data["intrinsics"][0]] * 3)
    with pytest.raises(DeuxError, match=r"^intrinsics has the shape 3 x 3 x 3: .* it is 3 x 3, or 2 x 3 x 3\.$"):
        deux.predict(**data, model=Doubling())


# ---------------------------------------------------------------------------------------------------- streams


def streamed(count: int, drawn: list[int] | None = None, **options):
    """`deux.predict` on generators of that many frames; `drawn` is told which images were asked for."""
    frames = [frame(seed) for seed in range(count)]

    def images():
        for number, one in enumerate(frames):
            if drawn is not None:
                drawn.append(number)
            yield one["image"]

    points = (one["sparse_depth"] for one in frames)
    return deux.predict(images(), points, frames[0]["intrinsics"], **{"model": Doubling(), **options})


@pytest.mark.parametrize("batch_size", [1, 2, 10])
def test_a_stream_gives_what_single_frames_give(batch_size):
    found = list(streamed(5, batch_size=batch_size))
    assert len(found) == 5
    for seed, depth in enumerate(found):
        np.testing.assert_allclose(depth, deux.predict(**frame(seed), model=Doubling()), rtol=1e-6)


@pytest.mark.parametrize(("batch_size", "asked_for"), [(1, [0]), (3, [0, 1, 2])])
def test_a_stream_asks_for_no_more_than_it_needs(batch_size, asked_for):
    drawn: list[int] = []
    depths = streamed(9, drawn, batch_size=batch_size)
    assert drawn == []
    next(depths)
    assert drawn == asked_for


def test_frames_of_a_stream_may_differ_in_size_and_camera():
    one, other = frame(0), frame(1)
    other |= {"image": other["image"][:20], "sparse_depth": other["sparse_depth"][:20]}
    other["intrinsics"] = other["intrinsics"] * [[2.0], [2.0], [1.0]]
    given = [one, other, one]
    columns = (iter([each[name] for each in given]) for name in ("image", "sparse_depth", "intrinsics"))
    for depth, each in zip(deux.predict(*columns, model=Doubling(), batch_size=2), given, strict=True):
        np.testing.assert_allclose(depth, deux.predict(**each, model=Doubling()), rtol=1e-6)


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"image": "array"}, "one of image and sparse_depth is an iterator and the other is not: both are, or neither"),
        ({"sparse_depth": "short"}, "sparse_depth ended after 1 frames, and the others did not"),
        ({"intrinsics": "short"}, "intrinsics ended after 1 frames, and the others did not"),
        ({"sparse_depth": "wide"}, "frame 1: sparse_depth has the shape 37 x 51"),
        ({"image": "batch"}, "frame 1: image has the shape 1 x 37 x 50 x 3: a stream gives H x W x 3"),
        ({"batch_size": 0}, "batch_size is 0: it must be at least 1"),
        ({"batch_size": 1.5}, r"batch_size is 1\.5: it must be a whole number"),
    ],
)
def test_a_stream_that_cannot_be(change, sentence):
    streams = {name: [frame(seed)[name] for seed in range(3)] for name in ("image", "sparse_depth", "intrinsics")}
    ((option, how),) = change.items()
    if how == "short":
        streams[option] = streams[option][:1]
    elif how == "wide":
        streams[option][1] = np.zeros((HEIGHT, WIDTH + 1))
    elif how == "batch":
        streams["image"][1], streams["sparse_depth"][1] = streams["image"][1][None], streams["sparse_depth"][1][None]
    given = {name: iter(values) for name, values in streams.items()}
    if how == "array":
        given["image"] = np.stack(streams["image"])
    with pytest.raises(DeuxError, match=sentence):
        list(deux.predict(**given, model=Doubling(), **({"batch_size": how} if option == "batch_size" else {})))
