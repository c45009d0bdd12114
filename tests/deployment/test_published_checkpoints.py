import pickle
from typing import ClassVar

import pytest
import torch
from torch import nn

import deux
from deux.contracts import DepthModel, Prediction
from deux.deployment.published_checkpoints import save_published
from deux.errors import DeuxError
from deux.registry import registry


class Pose(nn.Module):
    def __init__(self) -> None:
        super().__init__()
        self.encoder = nn.Linear(3, 2)

    def forward(self, target_image, source_image):
        raise NotImplementedError

    def published_modules(self):
        return {"pose_state_dict": self.encoder}


class Two(DepthModel):
    """A model whose published checkpoints have two parts."""

    min_depth = 0.1
    max_depth = 10.0

    def __init__(self, width: int = 4) -> None:
        super().__init__()
        self.near = nn.Linear(2, width)
        self.far = nn.Linear(2, 2)

    def forward(self, image, sparse_depth, validity, intrinsics, **prepared):
        return Prediction(1 + image.mean(1, keepdim=True))

    def pose_network(self):
        return Pose()

    def published_modules(self):
        return {"near_state_dict": self.near, "far_state_dict": self.far}


class Wrapped(Two):
    """A model whose published code wraps its modules in DataParallel."""

    published_prefix = "module."


class WithRange(Two):
    """A model whose depth range is an option."""

    def __init__(self, min_depth: float = 0.1, max_depth: float = 10.0) -> None:
        super().__init__()
        self.min_depth, self.max_depth = min_depth, max_depth


class Plain(Two):
    """A model without published checkpoints."""

    def published_modules(self):
        return {}


@pytest.fixture(autouse=True)
def _installed():
    for name, cls in (("two", Two), ("wrapped", Wrapped), ("with_range", WithRange), ("plain", Plain)):
        registry().register("depth_models", name, cls)
    yield
    for name in ("two", "wrapped", "with_range", "plain"):
        registry().unregister("depth_models", name)


def checkpoint_of(target, prefix=""):
    states = {group: module.state_dict() for group, module in target.published_modules().items()}
    prefixed = {group: {prefix + key: value for key, value in state.items()} for group, state in states.items()}
    return {"train_step": 3, **prefixed}


@pytest.fixture
def path(tmp_path):
    return tmp_path / "published.pth"


@pytest.mark.parametrize("prefix", ["", "module."])
def test_weights_arrive(path, prefix):
    published = Two()
    torch.save(checkpoint_of(published, prefix), path)
    model = deux.load_published("two", path)
    assert not model.training
    for key, value in published.state_dict().items():
        assert torch.equal(model.state_dict()[key], value)


def test_pose_network_is_made_with_its_published_weights(path, tmp_path):
    torch.save(checkpoint_of(Two()), path)
    published = Pose()
    torch.save(checkpoint_of(published), tmp_path / "pose.pth")
    model = deux.load_published("two", path, tmp_path / "pose.pth")
    first, second = model.pose_network(), model.pose_network()
    assert torch.equal(first.encoder.weight, published.encoder.weight)
    assert first is not second
    assert first.encoder.weight.data_ptr() != second.encoder.weight.data_ptr()
    assert model.state_dict().keys() == Two().state_dict().keys()


def test_options_other_than_the_defaults(path):
    torch.save(checkpoint_of(Two(width=6)), path)
    assert deux.load_published("two", path, settings={"width": 6}).near.out_features == 6
    with pytest.raises(
        DeuxError, match=r"near_state_dict has 2 tensors of another shape \(weight: 6 x 2 instead of 4 x 2"
    ):
        deux.load_published("two", path)


def test_a_range_that_nobody_named_is_reported_once(path, caplog):
    torch.save(checkpoint_of(Two()), path)
    for _ in range(2):
        assert deux.load_published("with_range", path).max_depth == 10.0
    (message,) = caplog.messages
    assert message.startswith(f"{path} does not contain the depth range of its training, and with_range's ")
    assert "default of 0.1 to 10 m gives wrong depths" in message
    assert 'settings={"max_depth": ...} or model.max_depth=... on the command line' in message


@pytest.mark.parametrize("settings", [{"max_depth": 8.0}, {"min_depth": 0.2}, {"max_depth": 10.0}], ids=str)
def test_a_range_that_was_named_needs_no_warning(path, caplog, settings):
    torch.save(checkpoint_of(Two()), path)
    model = deux.load_published("with_range", path, settings=settings)
    assert {name: getattr(model, name) for name in settings} == settings
    assert not caplog.messages


def test_a_model_without_a_range_to_choose_needs_no_warning(path, caplog):
    torch.save(checkpoint_of(Two()), path)
    deux.load_published("two", path)
    assert not caplog.messages


def test_a_published_model_becomes_a_folder_to_share(path, tmp_path):
    torch.save(checkpoint_of(published := Two(width=6)), path)
    folder = deux.load_published("two", path, settings={"width": 6}).save_pretrained(tmp_path / "shared")
    shared = deux.from_pretrained(folder)
    for key, value in published.state_dict().items():
        assert torch.equal(shared.state_dict()[key], value)


def test_names_that_are_missing_or_unexpected(path):
    checkpoint = checkpoint_of(Two())
    checkpoint["far_state_dict"]["scale"] = checkpoint["far_state_dict"].pop("bias")
    torch.save(checkpoint, path)
    with pytest.raises(
        DeuxError, match=r"far_state_dict lacks 1 tensor \(bias\), has 1 tensor unexpected \(scale\)\.$"
    ):
        deux.load_published("two", path)


def test_a_checkpoint_of_another_model_is_recognised(path):
    torch.save(checkpoint_of(Two()), path)
    expected = "of kbnet: it lacks sparse_to_dense_pool_state_dict, .*; it looks like a checkpoint of two"
    with pytest.raises(DeuxError, match=expected):
        deux.load_published("kbnet", path)


def test_the_pose_checkpoint_in_place_of_the_model(path):
    torch.save(checkpoint_of(Pose()), path)
    with pytest.raises(DeuxError, match=r"it looks like a checkpoint of (two's|plain's) pose network"):
        deux.load_published("two", path)


def test_the_model_in_place_of_the_pose_checkpoint(path):
    torch.save(checkpoint_of(Two()), path)
    expected = "of two's pose network: it lacks pose_state_dict; it looks like a checkpoint of two"
    with pytest.raises(DeuxError, match=expected):
        deux.load_published("two", path, path)


def test_a_broken_plugin_does_not_hide_what_is_wrong(path):
    class Broken(Two):
        def __init__(self) -> None:
            raise RuntimeError("no")

    registry().register("depth_models", "broken", Broken)
    torch.save({"weights": {}}, path)
    try:
        with pytest.raises(DeuxError, match="of two: it lacks near_state_dict, far_state_dict"):
            deux.load_published("two", path)
    finally:
        registry().unregister("depth_models", "broken")


def test_a_model_without_published_checkpoints(path):
    with pytest.raises(DeuxError, match="'plain' has no published checkpoints"):
        deux.load_published("plain", path)


def test_a_file_that_would_execute_code(path):
    class Mischief:
        def __reduce__(self):
            return print, ("executed",)

    path.write_bytes(pickle.dumps(Mischief()))
    with pytest.raises(DeuxError, match="cannot be read as a checkpoint of tensors"):
        deux.load_published("two", path)


@pytest.mark.parametrize("content", [b"", b"no checkpoint at all"])
def test_a_file_that_is_no_checkpoint(path, content):
    path.write_bytes(content)
    with pytest.raises(DeuxError, match=r"published\.pth cannot be read"):
        deux.load_published("two", path)


def test_a_file_of_something_else(path):
    torch.save([1, 2], path)
    with pytest.raises(DeuxError, match="is a list, but"):
        deux.load_published("two", path)
    torch.save({"near_state_dict": {"weight": 1}, "far_state_dict": {}}, path)
    with pytest.raises(DeuxError, match="near_state_dict contains values that are not tensors"):
        deux.load_published("two", path)


def test_no_file(path):
    with pytest.raises(DeuxError, match="there is no checkpoint"):
        deux.load_published("two", path)


@pytest.mark.parametrize(("cls", "name", "prefix"), [(Two, "two", ""), (Wrapped, "wrapped", "module.")])
def test_a_model_is_written_as_published_and_read_back(path, cls, name, prefix):
    model = cls()
    save_published(model, name, path)
    written = torch.load(path, weights_only=True)
    assert written.keys() == {"train_step", "near_state_dict", "far_state_dict"}
    assert list(written["near_state_dict"]) == [f"{prefix}weight", f"{prefix}bias"]
    back = deux.load_published(name, path).state_dict()
    assert all(torch.equal(back[key], value) for key, value in model.state_dict().items())


def test_a_model_without_published_code_is_not_written(path):
    with pytest.raises(DeuxError, match=r"'plain' has no published code that could load it: use export.format=onnx\.$"):
        save_published(Plain(), "plain", path)
    assert not path.exists()


class Fixed(Two):
    """A model that deux makes with an option that the published code does not have."""

    published_options: ClassVar[dict[str, int]] = {"margin": 0}

    def __init__(self, margin: int = 4) -> None:
        super().__init__()
        self.margin = margin


@pytest.fixture
def fixed():
    registry().register("depth_models", "fixed", Fixed)
    yield
    registry().unregister("depth_models", "fixed")


@pytest.mark.usefixtures("fixed")
def test_options_that_are_asked_for_are_those_of_the_model(path):
    torch.save(checkpoint_of(Fixed()), path)
    assert deux.load_published("fixed", path).margin == 0
    assert deux.load_published("fixed", path, settings={"margin": 2}).margin == 2


@pytest.mark.usefixtures("fixed")
def test_what_the_published_code_does_not_compute_is_reported(path, caplog):
    save_published(Fixed(margin=0), "fixed", path)
    assert not caplog.messages
    save_published(Fixed(), "fixed", path)
    assert caplog.messages == [
        f"{path} is a fixed with margin=4, but its published code uses margin=0, so that its depth will "
        "differ: load it by deux.load_published with settings={'margin': 4} for the same depth."
    ]
