"""Models by name: those that ship, and those that another package would bring."""

import logging
from importlib.metadata import EntryPoint

import pytest
import safetensors.torch
import torch

import deux
from deux.deployment import shipped_models
from deux.deployment.model_files import load_model, model_name, save_model
from deux.deployment.shipped_models import CARD_KEY, shipped_files
from deux.errors import DeuxError
from deux.registry import registry

SMALL = {"image_filters": (4,) * 5, "depth_filters": (4,) * 5, "decoder_filters": (4,) * 5}


@pytest.fixture
def packages(tmp_path, monkeypatch):
    """Install packages with trained models: packages(first=["small"], second=["small", "other"])."""
    made = tmp_path / "packages"

    def install(**packages: list[str]) -> None:
        entries = []
        for package, names in packages.items():
            (made / package / "weights").mkdir(parents=True)
            (made / package / "__init__.py").touch()
            for name in names:
                model = registry().create("depth_models", "kbnet", SMALL)
                header = {CARD_KEY: '{"summary": "a small one"}'}
                file = made / package / "weights" / f"{name}.safetensors"
                save_model(file, model, "kbnet", SMALL, half=True, header=header)
            entries.append(EntryPoint(package, package, shipped_models.GROUP))
        entries.append(EntryPoint("broken", "no_such_package", shipped_models.GROUP))
        monkeypatch.setattr(registry(), "entry_points", lambda group: entries)
        monkeypatch.syspath_prepend(str(made))

    shipped_files.cache_clear()
    yield install
    shipped_files.cache_clear()


def test_a_package_brings_models_by_name(packages, caplog):
    packages(deux_test_models=["small"])
    with caplog.at_level(logging.WARNING):
        assert deux.available() == {"small": "a small one"}
    assert "the trained models of no_such_package are left out" in caplog.text
    assert model_name("small") == "kbnet"
    assert load_model("small").state_dict().keys() == deux.load(shipped_files()["small"]).state_dict().keys()


def test_two_models_of_one_name_are_reported(packages, caplog):
    packages(deux_first_models=["small"], deux_second_models=["small", "other"])
    with caplog.at_level(logging.WARNING):
        assert sorted(deux.available()) == ["other", "small"]
    assert "two models called small" in caplog.text
    assert "deux_first_models" in str(shipped_files()["small"])


def test_what_exists_goes_before_a_name(packages, tmp_path, monkeypatch):
    packages(deux_shadowed_models=["small"])
    monkeypatch.chdir(tmp_path)
    model = registry().create("depth_models", "kbnet", SMALL)
    (tmp_path / "small").mkdir()
    save_model(tmp_path / "small" / "model.safetensors", model, "kbnet", SMALL)
    loaded, mine = load_model("small").state_dict(), model.state_dict()
    assert all(torch.equal(loaded[name], mine[name]) for name in mine)


def test_an_unknown_name_lists_those_that_ship(packages):
    packages(deux_models_of_two_sizes=["small", "large"])
    with pytest.raises(DeuxError, match=r"there is no model medium: .* a shipped model \(large, small\)\."):
        deux.load("medium")


def test_half_precision_files_are_half_the_size_and_load_as_float32(tmp_path):
    model = registry().create("depth_models", "scaffnet", {})  # batch normalisation counts in whole numbers
    for name, half in (("whole", False), ("half", True)):
        save_model(tmp_path / f"{name}.safetensors", model, "scaffnet", {}, half=half)
    sizes = [(tmp_path / f"{name}.safetensors").stat().st_size for name in ("half", "whole")]
    assert sizes[0] < 0.51 * sizes[1]
    stored = safetensors.torch.load_file(tmp_path / "half.safetensors")
    loaded = load_model(tmp_path / "half.safetensors").state_dict()
    for name, value in model.state_dict().items():
        assert loaded[name].dtype == value.dtype
        assert stored[name].dtype == (torch.float16 if value.is_floating_point() else value.dtype)
        torch.testing.assert_close(loaded[name], value, rtol=1e-3, atol=1e-7)
