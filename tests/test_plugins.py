"""`python -m deux.plugins`."""

import os
import subprocess
import sys
from dataclasses import dataclass
from enum import Enum
from pathlib import Path

import pytest
from torch import Tensor

from deux import plugins
from deux.contracts import LossInputs, LossTerm
from deux.plugin_kinds import Plugin
from deux.registry import Registry


@pytest.fixture
def two_of_a_name(monkeypatch: pytest.MonkeyPatch) -> Registry:
    """The installed plugins, and a second package with a loss term called `sparse_depth`."""
    found = Registry()
    second = Plugin("sparse_depth", "losses", "other-package", "2.0", "other:Term", lambda: None)
    monkeypatch.setattr(found, "_plugins", {"losses": [*found.plugins("losses"), second]})
    monkeypatch.setattr(plugins, "registry", lambda: found)
    return found


def test_the_listing_has_one_line_for_each_plugin(capsys: pytest.CaptureFixture[str]) -> None:
    assert plugins.main([]) == 0
    rows = [line.split("\t") for line in capsys.readouterr().out.splitlines()]
    assert rows[0] == ["kind", "name", "package", "version", "state"]
    assert ["explorer", "random", "deux", "0.1.0"] in rows
    assert ["reward", "coverage", "deux", "0.1.0"] in rows
    for kind, described in plugins.KINDS.items():
        listed = [name for noun, name, *_ in rows if noun == described.noun]
        assert listed == [plugin.name for plugin in Registry().plugins(kind)]


@pytest.mark.usefixtures("two_of_a_name")
def test_a_name_that_is_used_twice_is_marked_and_is_an_error_when_asked_for(
    capsys: pytest.CaptureFixture[str],
) -> None:
    marked = {(row[1], row[2]) for row in plugins.listing() if row[-1] == "the name is used twice"}
    assert marked == {("sparse_depth", "deux"), ("sparse_depth", "other-package")}
    assert plugins.main(["sparse_depth"]) == 1
    assert "'sparse_depth' belongs to 2 loss terms, of deux" in capsys.readouterr().err


def test_one_plugin_is_explained_with_the_options_of_its_constructor(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert plugins.main(["kbnet"]) == 0
    text = capsys.readouterr().out
    assert text.startswith("depth model kbnet, from deux 0.1.0 (deux_plugins.depth_models.kbnet:KBNet)\n")
    assert "\n  model.max_depth: a number, default " in text


class Side(Enum):
    LEFT = "left"


@dataclass(frozen=True)
class Stride:
    length: float = 0.5
    side: Side = Side.LEFT


class Options(LossTerm):
    def __init__(self, side: Side = Side.LEFT, stride: Stride = Stride(), limit: float | None = None) -> None: ...

    def __call__(self, inputs: LossInputs) -> Tensor:
        return inputs.prediction.depth.mean()


def test_defaults_are_written_as_a_command_line_takes_them(monkeypatch: pytest.MonkeyPatch) -> None:
    found = Registry()
    found.register("losses", "with_options", Options)
    monkeypatch.setattr(plugins, "registry", lambda: found)
    assert plugins.describe_plugin("with_options").splitlines()[-3:] == [
        "  objective.with_options.side: LEFT, default LEFT",
        "  objective.with_options.stride: options by name (length, side), default {length: 0.5, side: LEFT}",
        "  objective.with_options.limit: a number or null, default null",
    ]


class Undescribed(Options):
    def __init__(self, gain=1.0, **settings) -> None: ...  # type: ignore[no-untyped-def]


def test_a_plugin_without_a_description_does_not_get_that_of_its_base_class(monkeypatch: pytest.MonkeyPatch) -> None:
    found = Registry()
    found.register("losses", "undescribed", Undescribed)
    monkeypatch.setattr(plugins, "registry", lambda: found)
    assert plugins.describe_plugin("undescribed").splitlines()[2:] == [
        "(no description)",
        "",
        "  objective.undescribed.gain: any value, default 1.0",
        "  objective.undescribed.*: any other option, unchecked: a misspelt one is not noticed",
    ]


def test_an_unknown_name_is_answered_in_one_sentence(capsys: pytest.CaptureFixture[str]) -> None:
    assert plugins.main(["kbnt"]) == 1
    assert capsys.readouterr().err.startswith("deux: there is no plugin called 'kbnt': did you mean kbnet?")


def test_a_name_of_two_kinds_is_explained_for_each(capsys: pytest.CaptureFixture[str]) -> None:
    """An explorer and the reward that it is trained for."""
    assert plugins.main(["novelty"]) == 0
    explorer, reward = capsys.readouterr().out.split("\n\nreward ")
    assert explorer.startswith("explorer novelty, from deux 0.1.0 (deux_plugins.explorers.learned:NoveltyExplorer)\n")
    assert "\n  explore.weights: " in explorer
    assert reward.startswith("novelty, from deux 0.1.0 (deux_plugins.rewards.novelty:NoveltyReward)\n")
    assert "\n  explorer_training.reward_options.cell: a number, default 0.5" in reward


def test_entry_points_of_a_group_that_is_none_are_listed_with_the_one_that_is_meant(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    metadata = tmp_path / "typing_error-1.0.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: typing-error\nVersion: 1.0\n")
    (metadata / "entry_points.txt").write_text("[deux.explorer]\nspiral = spiral:Spiral\n\n[deux.xyz]\na = a:A\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    found = Registry()
    monkeypatch.setattr(plugins, "registry", lambda: found)
    assert [row for row in plugins.listing() if row[2] == "typing-error"] == [
        ("deux.explorer", "spiral", "typing-error", "1.0", "there is no such group; did you mean deux.explorers?"),
        ("deux.xyz", "a", "typing-error", "1.0", "there is no such group"),
    ]
    assert not [row for row in plugins.listing() if row[0] in ("deux.weights", "deux.conf")]


@pytest.mark.parametrize("arguments", [[], ["kbnet"]])
def test_a_reader_that_has_seen_enough_is_no_error(arguments: list[str]) -> None:
    reader, writer = os.pipe()
    os.close(reader)
    try:
        command = [sys.executable, "-m", "deux.plugins", *arguments]
        result = subprocess.run(command, stdout=writer, stderr=subprocess.PIPE, text=True, check=False)
    finally:
        os.close(writer)
    assert (result.returncode, result.stderr) == (0, "")
