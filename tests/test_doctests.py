"""The examples in the docstrings do what they show."""

import doctest
import importlib
from pathlib import Path

import numpy as np
import pytest

import deux
from deux.deployment.model_files import save_model
from deux.deployment.published_checkpoints import save_published
from deux.registry import registry

ROOT = Path(__file__).resolve().parents[1]
MODULES = sorted(
    ".".join(("deux_plugins" if top == "plugins" else top, *path.relative_to(ROOT / top).with_suffix("").parts))
    for top in ("deux", "plugins")
    for path in (ROOT / top).rglob("*.py")
    if ">>> " in path.read_text()
)
PUBLIC = (
    "load",
    "load_model",
    "load_published",
    "predict_arrays",
    "depth_errors",
    "interpolate",
    "reproject",
    "sample_sparse",
    "compose",
)
"""Functions that the documentation uses; each shows itself in two lines."""


@pytest.fixture(scope="module")
def frame() -> dict[str, np.ndarray]:
    """What examples call by these names: a frame that is given."""
    rng = np.random.default_rng(0)
    sparse_depth = np.where(rng.random((32, 48)) < 0.05, 2.0, 0.0).astype(np.float32)
    return {
        "image": rng.integers(0, 255, (32, 48, 3), np.uint8),
        "sparse_depth": sparse_depth,
        "intrinsics": np.array([[24.0, 0.0, 23.5], [0.0, 24.0, 15.5], [0.0, 0.0, 1.0]]),
    }


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """A working folder with a run and a published checkpoint."""
    path = tmp_path_factory.mktemp("work")
    run = path / "outputs" / "runs" / "kbnet-deux-1a2b3c4d"
    run.mkdir(parents=True)
    model = registry().create("depth_models", "kbnet", {})
    save_model(run / "model.safetensors", model, "kbnet", {})
    save_published(model, "kbnet", path / "kbnet-void1500.pth")
    return path


@pytest.mark.parametrize("name", MODULES)
def test_examples(name, frame, folder, monkeypatch):
    monkeypatch.chdir(folder)
    module = importlib.import_module(name)
    given = {"deux": deux, **frame}
    found = [test for test in doctest.DocTestFinder().find(module, name, extraglobs=given) if test.examples]
    runner = doctest.DocTestRunner(verbose=False, optionflags=doctest.ELLIPSIS)
    printed: list[str] = []
    for test in found:
        runner.run(test, out=printed.append)
    assert found
    assert runner.failures == 0, "".join(printed)


def test_what_the_documentation_uses_has_an_example():
    shown = {
        test.name.rpartition(".")[2]
        for name in MODULES
        for test in doctest.DocTestFinder().find(importlib.import_module(name), name)
        if test.examples
    }
    assert set(PUBLIC) <= shown
