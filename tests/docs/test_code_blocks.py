"""The Python blocks of README and docs/: their imports exist, and they run."""

import ast
import importlib
import os
import re
import sys
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from PIL import Image

import deux.contracts
from deux.data.dataset_reader import DatasetReader
from deux.data.exported_split import ExportedSplit
from deux.data.shard_export import write_shards
from deux.deployment.model_files import save_model
from deux.deployment.onnx_export import check_packages, export_onnx
from deux.deployment.published_checkpoints import save_published
from deux.errors import DeuxError
from deux.registry import registry

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "tests" / folder) for folder in ("data", "collection")]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
RUN = "outputs/runs/kbnet-deux-1a2b3c4d"
"""The run that the pages use as an example."""


def blocks(page: Path) -> list[str]:
    """The Python blocks of a page, without those that include a file."""
    found = re.findall(r"^```python\n(.*?)^```", page.read_text(), re.M | re.S)
    return [block for block in found if "--8<--" not in block]


PARTS = [
    (page, number, block)
    for page in PAGES
    if not {"examples", "reference"} & set(page.relative_to(ROOT).parts)
    for number, block in enumerate(blocks(page))
]
WITH_BLOCKS = sorted({page for page, _, _ in PARTS})


def name_of(value: Any) -> str:
    return value.relative_to(ROOT).as_posix() if isinstance(value, Path) else ""


def test_there_are_blocks():
    assert {"README.md", "using-a-model.md", "plugins.md"} <= {page.name for page in WITH_BLOCKS}


@pytest.mark.parametrize(("page", "number", "block"), PARTS, ids=lambda value: name_of(value) or None)
def test_what_a_block_imports_of_deux_is_there(page, number, block):
    for node in ast.walk(ast.parse(block)):
        if isinstance(node, ast.ImportFrom) and str(node.module).startswith("deux"):
            module = importlib.import_module(str(node.module)) if "deux_example" not in str(node.module) else None
            for alias in node.names:
                assert module is None or hasattr(module, alias.name), f"{node.module}.{alias.name}"
        elif isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "deux":
            assert hasattr(deux, node.attr) or find_spec(f"deux.{node.attr}"), f"deux.{node.attr}"


def frame() -> dict[str, Any]:
    """What pages call a frame of the reader's own."""
    rng = np.random.default_rng(0)
    return {
        "image": rng.integers(0, 255, (64, 96, 3), np.uint8),
        "sparse_depth": np.where(rng.random((64, 96)) < 0.05, 2.0, 0.0).astype(np.float32),
        "intrinsics": np.array([[48.0, 0.0, 47.5], [0.0, 48.0, 31.5], [0.0, 0.0, 1.0]]),
    }


def trained_models(folder: Path) -> dict[str, Any]:
    """A run, a published checkpoint and an ONNX file, by the names that pages use."""
    try:
        check_packages()
    except DeuxError as error:
        pytest.skip(str(error))
    (folder / RUN).mkdir(parents=True)
    model = registry().create("depth_models", "kbnet", {})
    save_model(folder / RUN / "model.safetensors", model, "kbnet", {})
    save_published(model, "kbnet", folder / "kbnet-void1500.pth")
    (folder / "model.onnx").write_bytes(export_onnx(model.eval(), 64, 96).content)
    given = frame()
    return {**given, "images": lambda: iter([given["image"]] * 3), "points": lambda: iter([given["sparse_depth"]] * 3)}


def tensors() -> dict[str, Any]:
    """The same frame as a batch of one: N x C x H x W."""
    given = frame()
    return {
        "image": torch.from_numpy(given["image"]).permute(2, 0, 1)[None] / 255,
        "sparse_depth": torch.from_numpy(given["sparse_depth"])[None, None],
        "intrinsics": torch.from_numpy(given["intrinsics"]).float()[None],
    }


def shards(folder: Path) -> dict[str, Any]:
    """Tar shards of a training split."""
    void_layout = importlib.import_module("void_layout")
    reader = DatasetReader(void_layout.dataset(folder / "recorded"))
    split = ExportedSplit("train", reader, reader.triplets("train", (-1, -2)))
    for _ in write_shards(folder / "shards", [split]):
        pass
    return {}


def example_explorer(folder: Path) -> dict[str, Any]:
    """The contracts, and the explorer that the page calls by several names."""
    sys.path.insert(0, str(ROOT / "docs" / "examples" / "deux-example" / "src"))
    explorer = importlib.import_module("deux_example.wall_follower").WallFollower
    return {**vars(deux.contracts), "MyExplorer": explorer, "WallFollower": explorer}


def recorded_frame(folder: Path) -> dict[str, Any]:
    """A frame of a depth camera, in millimetres, and the libraries that the page imports in its sentence."""
    for name, values in (("images", frame()["image"]), ("depth", np.full((64, 96), 2000, np.uint16))):
        (folder / name).mkdir()
        Image.fromarray(values).save(folder / name / "00010.png")
    importlib.import_module("deux.collection.sparse")
    return {"np": np, "Image": Image, "deux": deux}


def one_frame(folder: Path) -> dict[str, Any]:
    return frame()


def nothing(folder: Path) -> dict[str, Any]:
    return {}


def habitat(folder: Path) -> dict[str, Any]:
    pytest.skip("needs Habitat-Sim and a scene of Matterport3D")


GIVEN: dict[str, Callable[[Path], dict[str, Any]]] = {
    "README.md": trained_models,
    "docs/using-a-model.md": trained_models,
    "docs/shipped-models.md": one_frame,
    "docs/export.md": shards,
    "docs/plugins.md": example_explorer,
    "docs/habitat.md": habitat,
    "docs/earlier-results.md": recorded_frame,
}
"""What the blocks of a page find; those of other pages need nothing."""


SLOW = ("README.md", "docs/houses.md", "docs/using-a-model.md")
"""Pages whose blocks export a model or make houses."""


@pytest.mark.parametrize(
    "page",
    [pytest.param(page, marks=pytest.mark.slow if name_of(page) in SLOW else ()) for page in WITH_BLOCKS],
    ids=name_of,
)
def test_the_blocks_of_a_page_run_one_after_the_other(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(os.getcwd())
    names = GIVEN.get(name_of(page), nothing)(tmp_path)
    for number, block in enumerate(blocks(page)):
        for statement in ast.parse(block).body:
            if "# tensors" in block.splitlines()[(statement.end_lineno or 1) - 1]:
                names |= tensors()  # the block calls arrays and tensors by one name
            exec(compile(ast.Module([statement], []), f"{page.name}, block {number}", "exec"), names)
