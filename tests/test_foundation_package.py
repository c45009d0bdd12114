"""The package that wraps Depth Anything is installed here as anybody's would be; its weights are random and small."""

import os
import shutil
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from deux.io.images import write_depth

PACKAGE = Path(__file__).resolve().parents[1] / "docs" / "examples" / "deux-depth-anything"

pytestmark = pytest.mark.skipif(
    find_spec("transformers") is None, reason="transformers is not installed: pip install transformers"
)


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder into which the package is installed, from a copy."""
    source = tmp_path_factory.mktemp("source") / PACKAGE.name
    shutil.copytree(PACKAGE, source, ignore=shutil.ignore_patterns("__pycache__", "*.egg-info", "build"))
    folder = tmp_path_factory.mktemp("site")
    options = ["--no-deps", "--no-build-isolation", "--no-index", "--disable-pip-version-check"]
    command = [sys.executable, "-m", "pip", "install", *options, "--target", str(folder), str(source)]
    result = subprocess.run(command, capture_output=True, text=True, timeout=240, check=False)
    assert result.returncode == 0, result.stderr
    return folder


def python(site: Path, folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, *arguments],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(site)},
        capture_output=True,
        text=True,
        timeout=280,
        check=False,
    )


@pytest.fixture(scope="module")
def weights(site: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder as the hub has it, of a small network."""
    folder = tmp_path_factory.mktemp("weights")
    code = f"from test_depth_anything import *; write_network(Path({str(folder)!r}))"
    result = python(site, PACKAGE / "tests", "-c", code)
    assert result.returncode == 0, result.stderr
    return folder


def test_its_own_tests_pass(site: Path) -> None:
    result = python(site, PACKAGE, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-p", "no:xdist")
    assert result.returncode == 0, result.stdout


def test_it_predicts_a_frame(site: Path, weights: Path, tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    Image.fromarray(rng.integers(0, 256, (48, 64, 3), np.uint8)).save(tmp_path / "image.png")
    sparse = np.where(rng.random((48, 64)) < 0.05, 3.0, 0.0).astype(np.float32)
    write_depth(tmp_path / "sparse.png", sparse)
    np.savetxt(tmp_path / "K.txt", [[32.0, 0.0, 31.5], [0.0, 32.0, 23.5], [0.0, 0.0, 1.0]])
    frame = ["predict.image=image.png", "predict.sparse=sparse.png", "predict.intrinsics=K.txt"]
    model = ["model=depth_anything", f"model.weights={weights}", "model.resolution=56"]
    result = python(site, tmp_path, "-m", "deux", "task=predict", *model, *frame, "hydra.run.dir=run")
    assert (result.returncode, result.stderr) == (0, "")
    depth = np.load(tmp_path / "run" / "depth.npy")
    assert np.abs(depth - 3.0).mean() < 0.1  # all points are at 3 m


def test_it_guides_a_robot_as_the_seed_model(site: Path, weights: Path, tmp_path: Path) -> None:
    chosen = ["seed_model.name=depth_anything", f"seed_model.options.weights={weights}"]
    options = ["experiment=debug", "task=collect", "trainer.accelerator=cpu", "explore=deux"]
    size = ["seed_model.options.resolution=56", "collect.steps=12"]
    result = python(site, tmp_path, "-m", "deux", *options, *chosen, *size)
    assert (result.returncode, result.stderr) == (0, "")
    assert "Seed model: depth_anything, which is trained already" in result.stdout
    assert list(tmp_path.glob("outputs/datasets/deux-*/manifest.json"))
    assert not (tmp_path / "outputs" / "seed_models").exists()


def test_a_folder_without_weights_is_one_sentence(site: Path, tmp_path: Path) -> None:
    chosen = ["model=depth_anything", "model.weights=nowhere"]
    result = python(site, tmp_path, "-m", "deux", "task=predict", *chosen, "predict.image=a.png")
    assert result.returncode == 1
    assert "there is no nowhere/config.json: model.weights names a folder" in result.stderr
    assert "Traceback" not in result.stderr
