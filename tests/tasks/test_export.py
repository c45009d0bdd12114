"""`task=export`: what onnxruntime makes of the file is what the model predicts, for every model that ships."""

import json
import sys
from pathlib import Path

import numpy as np
import onnx
import onnxruntime
import pytest
import torch
from safetensors import safe_open

import deux as package
from deux.registry import registry
from deux.testing.depth_models import camera_data

HEIGHT, WIDTH = 45, 61
MODELS = ["kbnet", "voiced", "scaffnet", "fusionnet"]
PREPARED = {"voiced": ["scaffolding"]}


@pytest.fixture
def export(deux, tmp_path):
    """Run the task: export(checkpoint, **options) gives its outcome and where the file is to be."""

    def run(checkpoint: Path | None, *options: str):
        given = [] if checkpoint is None else [f"export.checkpoint={checkpoint}"]
        return deux("task=export", *given, f"hydra.run.dir={tmp_path}/run", *options), tmp_path / "run" / "model.onnx"

    return run


def user_inputs(model, count: int, size: tuple[int, int]) -> dict[str, np.ndarray]:
    """What a user feeds: a frame's data, with an outlier among the points, and what the model prepares."""
    data = camera_data(size, count, seed=count)
    data["sparse_depth"][:, 0, 10, 10:12] = torch.tensor([2.0, 6.0])
    samples = [model.prepare(depth) for depth in data["sparse_depth"][:, 0].numpy()]
    prepared = {name: np.stack([sample[name] for sample in samples]) for name in samples[0]}
    return {name: value.numpy() for name, value in data.items()} | prepared


def expected_depth(model, inputs: dict[str, np.ndarray]) -> np.ndarray:
    names = ("image", "sparse_depth", "intrinsics")
    return model.predict(*(torch.from_numpy(inputs[name]) for name in names)).numpy()


def run_file(path: Path, inputs: dict[str, np.ndarray]) -> np.ndarray:
    session = onnxruntime.InferenceSession(path, providers=["CPUExecutionProvider"])
    (depth,) = session.run(["depth"], inputs)
    return depth


def test_all_models_that_ship_are_tested():
    assert sorted(MODELS) == [plugin.name for plugin in registry().plugins("depth_models") if plugin.package == "deux"]


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=() if name == "voiced" else pytest.mark.slow) for name in MODELS]
)
def test_the_file_predicts_what_the_model_predicts(export, model_file, name):
    outcome, path = export(model_file(name), f"export.height={HEIGHT}", f"export.width={WIDTH}")
    assert (outcome.code, outcome.err) == (0, "")
    onnx.checker.check_model(path, full_check=True)
    session = onnxruntime.InferenceSession(path, providers=["CPUExecutionProvider"])
    names = ["image", "sparse_depth", "intrinsics", *PREPARED.get(name, [])]
    assert [node.name for node in session.get_inputs()] == names
    assert [(node.name, node.shape) for node in session.get_outputs()] == [("depth", ["N", 1, HEIGHT, WIDTH])]
    model = package.load(model_file(name))
    for count in (1, 2, 5):
        inputs = user_inputs(model, count, (HEIGHT, WIDTH))
        np.testing.assert_allclose(run_file(path, inputs), expected_depth(model, inputs), rtol=1e-3)
    assert str(path) in outcome.out
    assert all(f"  {name}: N x " in outcome.out for name in names)
    assert "difference between onnxruntime's and PyTorch's depth on random inputs: " in outcome.out


def test_the_cameras_size_a_fixed_number_and_no_path_of_this_machine(export, model_file):
    outcome, path = export(model_file("scaffnet"), "camera.height=32", "camera.width=48", "export.batch=2")
    assert (outcome.code, outcome.err) == (0, "")
    (depth,) = onnxruntime.InferenceSession(path).get_outputs()
    assert depth.shape == [2, 1, 32, 48]
    assert "  image: 2 x 3 x 32 x 48\n" in outcome.out
    model = package.load(model_file("scaffnet"))
    inputs = user_inputs(model, 2, (32, 48))
    np.testing.assert_allclose(run_file(path, inputs), expected_depth(model, inputs), rtol=1e-3)
    content = path.read_bytes()  # which names no folder of this machine
    assert str(Path(package.__file__).parent).encode() not in content
    assert sys.prefix.encode() not in content


@pytest.mark.parametrize("missing", [["onnxscript"], ["onnx", "onnxruntime"]])
def test_a_package_that_is_not_installed(export, model_file, monkeypatch, missing):
    for name in missing:
        monkeypatch.setitem(sys.modules, name, None)
    outcome, path = export(model_file("kbnet"))
    assert outcome.sentence == (
        f"exporting needs onnx, onnxscript and onnxruntime, and {' and '.join(missing)} "
        f'{"is" if len(missing) == 1 else "are"} not installed: pip install "deux[export]".'
    )
    assert not path.exists()


@pytest.mark.parametrize(
    ("option", "sentence"),
    [
        (
            "export.checkpoint=null",
            "a trained model is needed: set export.checkpoint= to a run folder, a model file, the ",
        ),
        ("export.checkpoint=nowhere", "there is no model "),
        ("export.height=0", "export.height is 0: it must be at least 1."),
        ("export.batch=-1", "export.batch is -1: it must be at least 1."),
        ("export.width=wide", "export.width must be a whole number or null, but is 'wide'."),
        ("export.heigth=3", "there is no option export.heigth: did you mean "),
    ],
)
def test_an_option_that_cannot_be(export, option, sentence):
    outcome, path = export(None, option)
    assert outcome.sentence.startswith(sentence)
    assert not path.exists()


@pytest.mark.parametrize("name", MODELS)
def test_published_checkpoint_has_the_recorded_layout_and_comes_back(export, model_file, shared_data, tmp_path, name):
    outcome, path = export(model_file(name), "export.format=published")
    assert (outcome.code, outcome.err) == (0, "")
    written = torch.load(path.with_name("model.pth"), weights_only=True)
    recorded = json.loads((shared_data("cases") / f"{name}.json").read_text())["keys"]
    recorded = {group: keys for group, keys in recorded.items() if not group.startswith("pose/")}
    assert written.keys() - {"train_step"} == set(recorded)
    for group, weights in recorded.items():
        assert list(written[group]) == [key for key, _ in weights]
    with safe_open(model_file(name), framework="pt") as file:
        settings = json.loads(file.metadata()["deux"])["settings"]
    back = package.load_published(name, path.with_name("model.pth"), settings=settings)
    model, data = package.load(model_file(name)), camera_data((64, 64), 2, seed=1)
    torch.testing.assert_close(back.predict(**data), model.predict(**data), rtol=1e-6, atol=1e-6)
