"""The package that wraps Depth Anything is installed here as anybody's would be; its weights are random and small."""

import importlib
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from deux.io.images import write_depth
from deux.registry import registry

PACKAGE = Path(__file__).resolve().parents[2] / "docs" / "examples" / "deux-depth-anything"

pytestmark = pytest.mark.skipif(
    find_spec("transformers") is None, reason="transformers is not installed: pip install transformers"
)


@pytest.fixture(scope="module")
def site(installed_copy: Callable[[Path], Path]) -> Path:
    """A folder into which the package is installed, from a copy."""
    return installed_copy(PACKAGE)


@pytest.fixture(scope="module")
def installed(site: Path) -> Iterator[None]:
    """The package is found by its entry point in this process."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(site))
        patch.syspath_prepend(str(PACKAGE / "tests"))
        registry.cache_clear()
        yield
    registry.cache_clear()


@pytest.fixture(scope="module")
def weights(installed: None, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder as the hub has it, of a small network."""
    written: Path = importlib.import_module("test_depth_anything").write_network(tmp_path_factory.mktemp("weights"))
    return written


@pytest.mark.slow
def test_its_own_tests_pass(site: Path) -> None:
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-p", "no:xdist"]
    environment = {**os.environ, "PYTHONPATH": str(site)}
    result = subprocess.run(command, cwd=PACKAGE, env=environment, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stdout


def test_it_predicts_a_frame(deux, weights: Path, tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    Image.fromarray(rng.integers(0, 256, (48, 64, 3), np.uint8)).save(tmp_path / "image.png")
    sparse = np.where(rng.random((48, 64)) < 0.05, 3.0, 0.0).astype(np.float32)
    write_depth(tmp_path / "sparse.png", sparse)
    np.savetxt(tmp_path / "K.txt", [[32.0, 0.0, 31.5], [0.0, 32.0, 23.5], [0.0, 0.0, 1.0]])
    files = {"image": "image.png", "sparse": "sparse.png", "intrinsics": "K.txt"}
    frame = [f"predict.{name}={tmp_path / file}" for name, file in files.items()]
    model = ["model=depth_anything", f"model.weights={weights}", "model.resolution=56"]
    outcome = deux("task=predict", *model, *frame, f"hydra.run.dir={tmp_path}/run")
    assert (outcome.code, outcome.err) == (0, "")
    depth = np.load(tmp_path / "run" / "depth.npy")
    assert np.abs(depth - 3.0).mean() < 0.1  # all points are at 3 m


def test_it_guides_a_robot_as_the_seed_model(tiny, weights: Path, tmp_path: Path) -> None:
    chosen = ["seed_model.name=depth_anything", f"seed_model.options.weights={weights}"]
    outcome = tiny(tmp_path, "task=collect", "explore=deux", *chosen, "seed_model.options.resolution=56")
    assert (outcome.code, outcome.err) == (0, "")
    assert "Seed model: depth_anything, pretrained" in outcome.out
    assert list(tmp_path.glob("datasets/deux-*/manifest.json"))
    assert not (tmp_path / "seed_models").exists()


@pytest.mark.usefixtures("installed")
def test_a_folder_without_weights_is_one_sentence(deux, tmp_path: Path) -> None:
    outcome = deux("task=predict", "model=depth_anything", f"model.weights={tmp_path}", f"hydra.run.dir={tmp_path}/run")
    assert outcome.sentence.startswith(f"there is no {tmp_path}/config.json: model.weights names a folder")
