"""The scripts and the notebook of examples/, run at debug size."""

import importlib.util
import json
import os
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
import void_layout
from PIL import Image

import deux
from deux.deployment.model_files import save_model
from deux.deployment.published_checkpoints import save_published
from deux.registry import registry
from deux.testing.explorers import ExplorerSuite

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
SMALL = {
    "image_filters": [8] * 5,
    "depth_filters": [4] * 5,
    "decoder_filters": [8, 8, 8, 8, 4],
}
"""Options of a KBNet that trains and predicts in no time."""


def example(name: str) -> ModuleType:
    """The script as a module."""
    spec = importlib.util.spec_from_file_location(f"example_{name}", EXAMPLES / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def folder(tmp_path, monkeypatch) -> Path:
    """An empty working folder."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def model(tmp_path) -> Path:
    """The file of a KBNet that has not learned anything."""
    path = tmp_path / "model.safetensors"
    save_model(path, registry().create("depth_models", "kbnet", SMALL), "kbnet", SMALL)
    return path


@pytest.fixture
def dataset(tmp_path) -> Path:
    """Recorded frames in VOID's layout with a train, a validation and a test split."""
    data = void_layout.dataset(tmp_path / "recorded")
    for split in ("validation", "test"):
        (data / f"{split}_triplets.txt").write_text((data / "train_triplets.txt").read_text())
    return data


@pytest.mark.parametrize("script", sorted(EXAMPLES.glob("*.py")), ids=lambda path: path.stem)
def test_a_script_is_short_and_documents_how_it_is_called(script):
    text = script.read_text()
    assert len(text.splitlines()) < 40
    assert f"python examples/{script.name}" in text.split('"""')[1]


def test_predict_one_frame(folder, model, dataset):
    base = dataset / "data" / "hall-00"
    files = [base / "image/000003.png", base / "sparse_depth/000003.png", base / "K.txt"]
    example("predict_one_frame").main(str(model), *map(str, files))
    depth = np.load(folder / "depth.npy")
    image, points, intrinsics = np.asarray(Image.open(files[0])), np.asarray(Image.open(files[1])) / 256, files[2]
    expected = deux.predict(image, points, np.loadtxt(intrinsics), model=model)
    np.testing.assert_array_equal(depth, expected)
    assert (folder / "depth.png").is_file()


def test_explore_a_mesh(folder):
    example("explore_a_mesh").main(steps=7)
    with Image.open(folder / "exploration.gif") as pictures:
        assert pictures.n_frames == 3
        first = np.asarray(pictures.convert("RGB")).astype(int)
        pictures.seek(2)
        last = np.asarray(pictures.convert("RGB")).astype(int)
    width = first.shape[1]
    # The map, on the right, grows: what is green then was black or green before.
    free = (last[:, width // 2 :, 1] > last[:, width // 2 :, 0] + 30).sum()
    assert free > (first[:, width // 2 :, 1] > first[:, width // 2 :, 0] + 30).sum()


def test_train_on_a_folder_then_evaluate_the_checkpoint(folder, dataset, monkeypatch, capsys):
    script = example("train_on_a_folder")
    create = registry().create
    monkeypatch.setattr(
        registry(),
        "create",
        lambda kind, name, options, *given: create(
            kind, name, {**options, **(SMALL if kind == "depth_models" else {})}, *given
        ),
    )
    monkeypatch.setattr(
        script, "save_model", lambda path, model, name, options: save_model(path, model, name, {**options, **SMALL})
    )
    path = script.main(str(dataset), steps=2, reader="deux")
    monkeypatch.undo()
    found = example("evaluate_a_checkpoint").main(str(folder / path), str(dataset), "deux")
    assert found.images == 12
    printed = capsys.readouterr().out
    assert f"{found.metrics['mae']:.1f}" in printed
    assert f"{found.baseline['irmse']:.1f}" in printed


def test_evaluate_a_published_checkpoint_with_its_options(folder, dataset, caplog):
    save_published(registry().create("depth_models", "kbnet", SMALL), "kbnet", folder / "kbnet.pth")
    network = [f"model.{name}={value}" for name, value in SMALL.items()]
    evaluate = example("evaluate_a_checkpoint").main
    named = [evaluate("kbnet:kbnet.pth", str(dataset), "deux", *network, f"model.max_depth={far}") for far in (8, 10)]
    assert named[0].metrics != named[1].metrics
    assert not caplog.messages
    near = evaluate("kbnet:kbnet.pth", str(dataset), "deux", *network, "model.max_depth=10", "camera.max_depth=2.5")
    assert near.baseline != named[1].baseline


class TestBouncer(ExplorerSuite):
    """The explorer of write_an_explorer.py fulfils the contract."""

    def make_explorer(self):
        return example("write_an_explorer").Bouncer()


@pytest.mark.slow
def test_write_an_explorer(folder):
    command = [sys.executable, EXAMPLES / "write_an_explorer.py", "experiment=debug", "explore.distance=0.8"]
    result = subprocess.run(command, capture_output=True, text=True, timeout=280, check=False)
    assert result.returncode == 0, result.stderr
    (manifest,) = folder.glob("outputs/datasets/bouncer-*/manifest.json")
    assert json.loads(manifest.read_text())["specification"]["explorer_settings"] == {"distance": 0.8}


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_the_notebook_runs(folder):
    nbformat = pytest.importorskip("nbformat", reason="the extra notebook is not installed")
    nbclient = pytest.importorskip("nbclient", reason="the extra notebook is not installed")
    pytest.importorskip("ipykernel", reason="the extra notebook is not installed")
    notebook = nbformat.read(EXAMPLES / "first_look.ipynb", as_version=4)
    assert all(not cell.get("outputs") for cell in notebook.cells), "commit it without outputs"
    environment = {**os.environ, "PYTHONWARNINGS": "ignore"}
    nbclient.NotebookClient(notebook, timeout=840, resources={"metadata": {"path": str(folder)}}).execute(
        env=environment
    )
    pictures = [
        output for cell in notebook.cells for output in cell.get("outputs", ()) if "image/png" in output.get("data", {})
    ]
    assert len(pictures) >= 3
