import sys
from enum import Enum
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from deux.contracts import LossInputs, LossTerm, Reward
from deux.errors import DeuxError
from deux.plugin_kinds import KINDS
from deux.registry import Registry, registry

TERM = """
from deux.contracts import LossTerm

class Term(LossTerm):
    def __init__(self, sharpness: float = 1.0) -> None:
        self.sharpness = sharpness

    def __call__(self, inputs):
        return inputs.prediction.depth.mean()

class Unfinished(LossTerm):
    pass

class Stranger:
    pass
"""


REWARD = """
from deux.contracts import Reward

class Steps(Reward):
    def __init__(self, worth: float = 1.0) -> None:
        self.worth = worth

    def reset(self, episode):
        pass

    def __call__(self, experience):
        return self.worth
"""


class Mean(LossTerm):
    def __call__(self, inputs: LossInputs) -> torch.Tensor:
        return inputs.prediction.depth.mean()


@pytest.fixture
def install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    """A function that installs a package as pip would leave it: a module, and metadata with entry points."""

    def install(package: str, code: str, losses: dict[str, str], version: str = "1.2") -> None:
        module = package.replace("-", "_")
        site = tmp_path / package
        metadata = site / f"{module}-{version}.dist-info"
        metadata.mkdir(parents=True)
        (site / f"{module}.py").write_text(code)
        (metadata / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {package}\nVersion: {version}\n")
        lines = [f"{name} = {module}:{attribute}" for name, attribute in losses.items()]
        (metadata / "entry_points.txt").write_text("\n".join(["[deux.losses]", *lines, ""]))
        monkeypatch.syspath_prepend(str(site))
        monkeypatch.delitem(sys.modules, module, raising=False)

    return install


def test_ships_plugins_of_every_kind_from_its_own_package() -> None:
    for kind in KINDS:
        own = [plugin for plugin in registry().plugins(kind) if plugin.package == "deux"]
        assert own
        assert all(
            plugin.kind == kind and plugin.target.startswith(("deux_plugins.", "deux.simulator.", "deux.data."))
            for plugin in own
        )
    assert registry() is registry()


def test_a_foreign_package_is_listed_without_being_imported(install: Any) -> None:
    install("foreign-term", TERM, {"foreign": "Term"}, version="3.1")
    found = Registry()
    plugin = found.find("losses", "foreign")
    assert (plugin.name, plugin.kind, plugin.package, plugin.version) == (
        "foreign",
        "losses",
        "foreign-term",
        "3.1",
    )
    assert plugin.target == "foreign_term:Term"
    assert "foreign" in found.names("losses")
    assert "foreign_term" not in sys.modules
    assert found.get("losses", "foreign").__name__ == "Term"


def test_create_checks_the_options_against_the_constructor(install: Any) -> None:
    install("foreign-term", TERM, {"foreign": "Term"})
    assert Registry().create("losses", "foreign", {"name": "foreign", "sharpness": 3}).sharpness == 3.0
    with pytest.raises(DeuxError, match=r"^objective\.foreign\.sharpnes is not an option of Term: did you mean sharp"):
        Registry().create("losses", "foreign", {"sharpnes": 3})


def test_an_unknown_name_is_answered_with_near_matches_and_all_names(install: Any) -> None:
    install("foreign-term", TERM, {"foreign": "Term"})
    with pytest.raises(DeuxError, match=r"no loss term called 'foriegn': did you mean foreign\? There is: .*foreign"):
        Registry().find("losses", "foriegn")
    with pytest.raises(DeuxError, match="'loss' is not a kind of plugin: did you mean losses"):
        Registry().names("loss")


def test_one_name_of_two_packages_is_an_error_that_names_both_when_it_is_asked_for(install: Any) -> None:
    install("first-term", TERM, {"shared": "Term", "alone": "Term"}, version="1.0")
    install("second-term", TERM, {"shared": "Term"}, version="2.0")
    found = Registry()
    assert found.names("losses").count("shared") == 1
    assert [plugin.package for plugin in found.plugins("losses") if plugin.name == "shared"] == [
        "first-term",
        "second-term",
    ]
    assert found.get("losses", "alone")
    with pytest.raises(
        DeuxError, match=r"'shared' belongs to 2 loss terms, of first-term 1\.0 .* and second-term 2\.0"
    ):
        found.get("losses", "shared")


@pytest.mark.parametrize(
    ("code", "cause"),
    [
        ("import no_such_module", "ModuleNotFoundError: No module named 'no_such_module'"),
        ("raise RuntimeError('needs a\\nGPU.')", "RuntimeError: needs a GPU."),
        ("", "AttributeError"),
        ("def broken(", "SyntaxError"),
    ],
)
def test_a_package_that_cannot_be_imported_fails_only_when_it_is_chosen(install: Any, code: str, cause: str) -> None:
    install("broken-term", code, {"broken": "Term"}, version="0.7")
    found = Registry()
    assert found.find("losses", "broken").version == "0.7"
    assert found.get("losses", "sparse_depth")
    with pytest.raises(DeuxError) as caught:
        found.get("losses", "broken")
    message = str(caught.value)
    assert message.startswith("the loss term 'broken' of broken-term 0.7 (broken_term:Term) cannot be imported: ")
    assert cause in message
    assert not message.endswith("..")
    assert "\n" not in message


def test_a_reward_comes_in_a_package_of_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    site = tmp_path / "foreign"
    metadata = site / "foreign_reward-1.0.dist-info"
    metadata.mkdir(parents=True)
    (site / "foreign_reward.py").write_text(REWARD)
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: foreign-reward\nVersion: 1.0\n")
    (metadata / "entry_points.txt").write_text("[deux.rewards]\nsteps = foreign_reward:Steps\n")
    monkeypatch.syspath_prepend(str(site))
    found = Registry()
    assert found.find("rewards", "steps").package == "foreign-reward"
    reward = found.create("rewards", "steps", {"worth": 2})
    assert isinstance(reward, Reward)
    assert (reward(None), reward.needs, reward.state()) == (2.0, frozenset(), {})
    with pytest.raises(DeuxError, match=r"^explorer_training\.reward_options\.worht is not an option of Steps"):
        found.create("rewards", "steps", {"worht": 2})
    with pytest.raises(DeuxError, match="there is no reward called 'step': did you mean steps"):
        found.find("rewards", "step")


def test_what_does_not_fulfil_the_contract_is_refused(install: Any) -> None:
    install("odd-term", TERM, {"stranger": "Stranger", "unfinished": "Unfinished"})
    with pytest.raises(DeuxError, match=r"odd-term 1\.2 .* is not a subclass of deux\.contracts\.LossTerm"):
        Registry().get("losses", "stranger")
    with pytest.raises(DeuxError, match=r"'unfinished' of odd-term .* does not define __call__"):
        Registry().get("losses", "unfinished")


def test_plugins_can_be_registered_by_hand() -> None:
    found = Registry()
    plugin = found.register("losses", "mean", Mean)
    assert plugin.package == "registered by hand"
    assert isinstance(found.create("losses", "mean", {}), Mean)
    assert "mean" not in Registry().names("losses")
    with pytest.raises(DeuxError, match="'mean' is there already, from registered by hand"):
        found.register("losses", "mean", Mean)
    with pytest.raises(DeuxError, match=r"is not a subclass of deux\.contracts\.Explorer"):
        found.register("explorers", "mean", Mean)
    assert found.unregister("losses", "mean") == plugin
    assert "mean" not in found.names("losses")


def test_reserved_options_reach_no_plugin() -> None:
    assert registry().choose("readers", {"name": "deux", "cache": "device"}).settings.keys().isdisjoint({"cache"})
    with pytest.raises(DeuxError, match=r"data.*cach"):
        registry().choose("readers", {"name": "deux", "cach": "device"})


def test_a_choice_knows_what_was_chosen() -> None:
    choice = registry().choose("depth_models", {"name": "kbnet", "max_depth": 10, "margin": 4})
    assert choice.chosen == {"max_depth": 10.0, "margin": 4}
    assert choice.chosen.keys() < choice.settings.keys()
    assert choice.create().max_depth == 10.0


def test_installed_packages_are_gone_through_once(monkeypatch: pytest.MonkeyPatch) -> None:
    calls = []
    monkeypatch.setattr("deux.registry.entry_points", lambda: calls.append("all") or metadata.entry_points())
    found = Registry()
    assert all(found.plugins(kind) for kind in KINDS)
    assert [entry.value for entry in found.entry_points("deux.weights") if entry.dist.name == "deux"]
    assert calls == ["all"]


class Shade(Enum):
    DARK = "dark"


class Shaded(Mean):
    def __init__(
        self, shade: Shade = Shade.DARK, kinds: frozenset[int] = frozenset(), count: int = np.int64(3), power: int = 1
    ) -> None:
        self.given = (shade, kinds, count, power)


def test_what_nobody_chose_is_left_to_the_constructors_own_defaults(monkeypatch: pytest.MonkeyPatch) -> None:
    found = Registry()
    found.register("losses", "shaded", Shaded)
    monkeypatch.setattr("deux.registry.registry", lambda: found)
    choice = found.choose("losses", {"name": "shaded", "power": 2})
    assert choice.settings == {"shade": "DARK", "kinds": [], "count": 3, "power": 2}
    assert choice.create().given == (Shade.DARK, frozenset(), 3, 2)
