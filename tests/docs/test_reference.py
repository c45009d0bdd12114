"""The page of all options, as docs/reference.py writes it."""

import re
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

import pytest
from omegaconf import OmegaConf

from deux.configuration import OPEN_NODES, compose
from deux.options import options
from deux.plugin_kinds import KINDS
from deux.registry import registry

ROOT = Path(__file__).resolve().parents[2]
PLUGIN_NODES = {"explore", "model", "simulator", "scenes", "data", "objective"}
PLUGIN_NODES |= {"collect.uncertainty_options", "predict.uncertainty_options", "seed_model.options"}
FREE_NODES = {"trainer", "callbacks"}
"""Nodes whose options are those of Lightning."""


@pytest.fixture(scope="module")
def page(tmp_path_factory) -> str:
    pytest.importorskip("griffe", reason="the extra docs is not installed")
    spec = spec_from_file_location("docs_reference", ROOT / "docs" / "reference.py")
    assert spec is not None
    assert spec.loader is not None
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.write_reference(tmp_path_factory.mktemp("docs") / "reference" / "configuration.md").read_text()


def test_every_option_of_every_plugin_has_a_line_that_explains_it(page):
    for kind in KINDS.values():
        for plugin in (one for one in registry().plugins(kind.name) if one.package == "deux"):
            where = kind.settings.format(name=plugin.name)
            for option in options(plugin.load(), kind.given):
                (line, *_) = re.findall(rf"^- `{re.escape(where)}\.{option}` \(.*", page, re.M)
                assert not line.endswith("): "), f"{kind.noun} {plugin.name} does not say what {option} is"


def test_every_section_is_there(page):
    sections = set(re.findall(r"^### `([\w.]+)`$", page, re.M))
    assert set(OPEN_NODES) - PLUGIN_NODES - FREE_NODES <= sections
    cfg = compose()
    named = {name for name in cfg if hasattr(cfg[name], "items")} - PLUGIN_NODES - FREE_NODES - {"paths"}
    assert named <= sections


@pytest.mark.parametrize(
    "line",
    [
        "- `camera.width` (a whole number; default `128`): image width in pixels.",
        "- `training.learning_rate` (a number; default `0.0005`): the rate",  # of a base class
        "- `training.offsets` (a list (each a whole number); default `[-1, -2]`): the recent source frames",
        "- `scenes.up` ('y' or 'z'; default `y`): the axis of the files that points up",
        "- `scenes.root` (text; required): ",
    ],
)
def test_type_and_default_are_those_of_the_command(page, line):
    assert line in page


def test_the_published_files_are_loaded_with_options_that_their_models_have():
    page = (ROOT / "docs" / "using-a-model.md").read_text()
    rows = re.findall(r"^\| `(\w+)-[\w]+\.pth` \| `(\w+)` \| `([^`]+)` \|", page, re.M)
    assert len(rows) == 6
    for file, model, given in rows:
        assert file == model
        settings = OmegaConf.to_container(OmegaConf.from_dotlist(given.split()))
        assert "max_depth" in registry().choose("depth_models", {"name": model, **settings}).chosen
