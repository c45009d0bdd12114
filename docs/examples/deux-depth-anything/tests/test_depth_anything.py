"""The real architecture of reduced size, with random weights; where the package transformers is missing, no tests."""

import json
from pathlib import Path
from typing import ClassVar

import pytest
import torch

from deux.contracts import DepthModel
from deux.errors import DeuxError
from deux.inference.weightless import without_weights
from deux.testing.depth_models import DepthModelSuite, camera_data

transformers = pytest.importorskip("transformers", reason="transformers is not installed: pip install transformers")
from deux_depth_anything.depth_anything import DepthAnything, network_size  # noqa: E402


def write_network(folder: Path, kind: str = "relative") -> Path:
    """A folder as the hub has it, with a network of 70,000 random weights."""
    backbone = transformers.Dinov2Config(
        image_size=56,
        hidden_size=24,
        num_hidden_layers=4,
        num_attention_heads=2,
        mlp_ratio=2,
        out_indices=[1, 2, 3, 4],
        reshape_hidden_states=False,
    )
    config = transformers.DepthAnythingConfig(
        backbone_config=backbone,
        reassemble_hidden_size=24,
        neck_hidden_sizes=[8, 8, 16, 16],
        fusion_hidden_size=16,
        head_hidden_size=8,
        initializer_range=0.1,  # from weights of the usual 0.02, an image of one value comes
        depth_estimation_type=kind,
        max_depth=10 if kind == "metric" else 1,
    )
    network = transformers.DepthAnythingForDepthEstimation(config)
    if kind == "relative":  # the last layer is a ReLU: random weights may leave it nothing
        torch.nn.init.constant_(network.head.conv3.bias, 1.0)
    network.save_pretrained(folder)
    return folder


class _Suite(DepthModelSuite):
    kind: ClassVar[str]

    @pytest.fixture(autouse=True)
    def _folder(self, tmp_path: Path) -> None:
        self.folder = tmp_path

    def make_model(self) -> DepthModel:
        return DepthAnything(str(write_network(self.folder, self.kind)), resolution=56)


class TestRelative(_Suite):
    kind = "relative"


class TestMetric(_Suite):
    kind = "metric"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    torch.manual_seed(0)
    return write_network(tmp_path)


@pytest.mark.parametrize("size", [(480, 640), (64, 96), (96, 64), (540, 360), (1080, 1920), (518, 518), (240, 640)])
def test_the_network_sees_what_the_published_preprocessing_makes(size: tuple[int, int], folder: Path) -> None:
    processor = transformers.DPTImageProcessor(
        size={"height": 518, "width": 518},
        ensure_multiple_of=14,
        keep_aspect_ratio=True,
        image_mean=[0.485, 0.456, 0.406],
        image_std=[0.229, 0.224, 0.225],
        do_rescale=False,
    )
    image = torch.rand(1, 3, *size)
    expected = processor(images=image, return_tensors="pt").pixel_values
    assert network_size(*size, 518, 14) == expected.shape[2:]
    model, seen = DepthAnything(str(folder)), []
    model.network.forward = lambda pixels: (
        seen.append(pixels) or transformers.modeling_outputs.DepthEstimatorOutput(predicted_depth=pixels[:, 0])
    )
    model.inverse_depth(image)
    torch.testing.assert_close(seen[0], expected, rtol=0, atol=2e-3)


def test_the_network_is_that_of_the_folder(folder: Path) -> None:
    network = transformers.AutoModelForDepthEstimation.from_pretrained(folder, local_files_only=True)
    model = DepthAnything(str(folder), resolution=56)
    image = camera_data((56, 56))["image"]
    with torch.no_grad():
        expected = network.eval()((image - model.mean) / model.deviation).predicted_depth[:, None]
        torch.testing.assert_close(model.eval().inverse_depth(image), expected)


def test_points_make_a_relative_depth_metric(folder: Path) -> None:
    model = DepthAnything(str(folder), resolution=56, correct=False).eval()
    data = camera_data((64, 96), points=0.02)
    with torch.no_grad():
        r = model.inverse_depth(data["image"])
        truth = 1.0 / (0.1 + 0.4 * (r - r.amin((2, 3), keepdim=True)) / (r.amax() - r.amin()))
    data["sparse_depth"] = torch.where(data["sparse_depth"] > 0, truth, 0.0)
    torch.testing.assert_close(model.predict(**data), truth, rtol=1e-3, atol=1e-3)


def test_the_correction_meets_the_points(folder: Path) -> None:
    data = camera_data((64, 96), points=0.005)
    at = data["sparse_depth"] > 0
    errors = [
        (DepthAnything(str(folder), 56, correct).eval().predict(**data) - data["sparse_depth"])[at].abs().mean()
        for correct in (False, True)
    ]
    assert errors[1] < 0.3 * errors[0]


def test_a_metric_network_needs_no_points(tmp_path: Path) -> None:
    model = DepthAnything(str(write_network(tmp_path, "metric")), resolution=56).eval()
    data = camera_data((56, 56), points=0.0)
    with torch.no_grad():
        metres = model.network((data["image"] - model.mean) / model.deviation).predicted_depth[:, None]
    torch.testing.assert_close(model.predict(**data), metres.clamp(0.1, 10.0), rtol=1e-4, atol=1e-4)


def test_it_is_made_without_memory(folder: Path) -> None:
    (folder / "model.safetensors").unlink()
    with without_weights():
        model = DepthAnything(str(folder))
    assert all(parameter.is_meta for parameter in model.parameters())


def test_other_folders_are_refused_in_one_sentence(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(DeuxError, match=r"there is no .*nowhere/config.json: model.weights names a folder"):
        DepthAnything(str(tmp_path / "nowhere"))
    weights = folder / "model.safetensors"
    kept = weights.read_bytes()
    for content in (kept[:-50], b"pickle"):
        weights.write_bytes(content)
        with pytest.raises(DeuxError, match=r"cannot be read: model.weights names a folder"):
            DepthAnything(str(folder))
    weights.rename(folder / "pytorch_model.bin")
    with pytest.raises(DeuxError, match=r"cannot be read: model.weights names a folder"):
        DepthAnything(str(folder))


def test_weights_of_another_network_are_refused(folder: Path) -> None:
    config = json.loads((folder / "config.json").read_text())
    config["backbone_config"]["num_hidden_layers"] = 5
    (folder / "config.json").write_text(json.dumps(config))
    with pytest.raises(DeuxError, match="it lacks backbone"):
        DepthAnything(str(folder))
