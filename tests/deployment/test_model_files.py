import subprocess
import sys
from enum import Enum

import pytest
import safetensors.torch
import torch
from torch import nn

import deux
from deux.contracts import DepthModel, Prediction
from deux.deployment.model_files import MODEL_FILE, load_model, model_name, save_model
from deux.errors import DeuxError
from deux.registry import registry
from deux.testing.depth_models import camera_data


class Scaled(DepthModel):
    """Predicts the mean colour, scaled."""

    min_depth = 0.1
    max_depth = 10.0

    def __init__(self, scale: float = 2.0, width: int = 3) -> None:
        super().__init__()
        self.scale = scale
        self.mix = nn.Conv2d(3, width, 1).to(memory_format=torch.channels_last)

    def forward(self, image, sparse_depth, validity, intrinsics, **prepared):
        return Prediction(self.scale * self.mix(image).mean(1, keepdim=True).sigmoid())


@pytest.fixture(autouse=True)
def _scaled_is_installed():
    registry().register("depth_models", "scaled", Scaled)
    yield
    registry().unregister("depth_models", "scaled")


def test_a_saved_model_predicts_the_same_with_its_own_options(tmp_path):
    model = Scaled(scale=5.0)
    save_model(tmp_path / MODEL_FILE, model, "scaled", {"scale": 5})
    expected = model.predict(**camera_data((8, 10)))
    for path in (tmp_path, tmp_path / MODEL_FILE, str(tmp_path)):
        loaded = deux.load(path)
        assert not loaded.training
        assert torch.equal(loaded.predict(**camera_data((8, 10))), expected)
    assert model_name(tmp_path) == "scaled"
    assert [file.name for file in tmp_path.iterdir()] == [MODEL_FILE]


def test_defaults_of_the_day_are_saved(tmp_path, monkeypatch):
    save_model(tmp_path / MODEL_FILE, Scaled(), "scaled", {})
    monkeypatch.setattr(Scaled.__init__, "__defaults__", (7.0, 3))
    assert load_model(tmp_path).scale == 2.0


def test_a_default_that_json_cannot_hold_is_left_to_the_constructor(tmp_path):
    class Side(Enum):
        LEFT = "left"

    class Sided(Scaled):
        def __init__(self, scale: float = 2.0, side: Side = Side.LEFT) -> None:
            super().__init__(scale)
            self.side = side

    registry().register("depth_models", "sided", Sided)
    try:
        save_model(tmp_path / MODEL_FILE, Sided(5.0), "sided", {"scale": 5})
        loaded = load_model(tmp_path)
    finally:
        registry().unregister("depth_models", "sided")
    assert (loaded.scale, loaded.side) == (5.0, Side.LEFT)


def test_nothing_there(tmp_path):
    with pytest.raises(DeuxError, match=r"there is no model .*model\.safetensors"):
        load_model(tmp_path)


def test_a_file_cut_short(tmp_path):
    file = tmp_path / MODEL_FILE
    save_model(file, Scaled(), "scaled", {})
    file.write_bytes(file.read_bytes()[:-20])
    with pytest.raises(DeuxError, match=f"{MODEL_FILE} cannot be read as safetensors"):
        load_model(tmp_path)


@pytest.mark.parametrize("name", ["kbnet-void1500.pth", "epoch=0-step=2.ckpt"])
def test_a_file_of_torch_is_not_reported_as_damaged(tmp_path, name):
    torch.save({"weight": torch.ones(1)}, tmp_path / name)
    with pytest.raises(DeuxError, match=r"written by torch\.save: load published checkpoints with deux\.load_pub"):
        load_model(tmp_path / name)


@pytest.mark.parametrize("path", [None, 3, Scaled])
def test_a_model_is_named_by_a_path(path):
    with pytest.raises(DeuxError, match=r"^a model cannot be loaded from a value of the type \w+: give the path"):
        load_model(path)


def test_weights_of_somebody_else(tmp_path):
    safetensors.torch.save_file({"weight": torch.ones(1)}, tmp_path / MODEL_FILE)
    with pytest.raises(DeuxError, match="has no configuration of a model"):
        load_model(tmp_path)


def test_weights_that_do_not_fit(tmp_path):
    model = Scaled(width=4)
    model.extra = nn.Linear(2, 2)
    save_model(tmp_path / MODEL_FILE, model, "scaled", {})
    expected = r"has 2 tensors unexpected \(extra\.bias, extra\.weight\), .* 4 x 3 x 1 x 1 instead of 3 x 3 x 1 x 1"
    with pytest.raises(DeuxError, match=expected):
        load_model(tmp_path)


def test_a_model_that_is_not_installed(tmp_path):
    save_model(tmp_path / MODEL_FILE, Scaled(), "scaled2", {})
    with pytest.raises(DeuxError, match="no depth model called 'scaled2'"):
        load_model(tmp_path)


def test_importing_deux_does_not_import_torch():
    code = "import sys, deux; assert 'torch' not in sys.modules; print(deux.load, deux.load_published)"
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stderr
    with pytest.raises(AttributeError, match="lod"):
        deux.lod  # noqa: B018
