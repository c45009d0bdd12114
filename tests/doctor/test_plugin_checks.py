"""What the doctor says of plugins: each is loaded, and one that cannot be harms nobody who does not choose it."""

from importlib.metadata import EntryPoint

import pytest

from deux.configuration import compose
from deux.contracts import Reader, Reward
from deux.doctor.checkup import Checkup
from deux.doctor.plugin_checks import check_chosen_plugins, check_plugins, lacking
from deux.plugin_kinds import KINDS, Plugin
from deux.registry import registry


@pytest.fixture
def add_plugin():
    """Adds a plugin by kind, name and target, as an entry point of a package "third-party" would."""
    added = []

    def add(kind: str, name: str, target: str) -> None:
        load = EntryPoint(name, target, f"deux.{kind}").load
        registry()._table(kind).append(Plugin(name, kind, "third-party", "0.3", target, load))
        added.append((kind, name))

    yield add
    for kind, name in added:
        registry().unregister(kind, name)


def report(check, *arguments) -> tuple[Checkup, dict[str, str], list[str]]:
    checkup = Checkup(show=False)
    check(checkup, *arguments)
    (section,) = checkup.as_json()["sections"]
    return checkup, dict(section["facts"]), [value for name, value in section["facts"] if name == "broken"]


def test_every_plugin_that_is_shipped_loads():
    checkup, facts, broken = report(check_plugins)
    assert not broken
    assert checkup.faults == 0
    for kind in KINDS:
        assert set(listed_names(facts[kind])) == set(registry().names(kind))


def listed_names(text: str) -> list[str]:
    return text.partition(" (")[0].split(", ")


def test_broken_plugins_are_listed_with_package_and_error(add_plugin, tmp_path, monkeypatch):
    (tmp_path / "third_party_leaver.py").write_text("raise SystemExit('no licence')\n")
    (tmp_path / "third_party_broken.py").write_text("1 / 0\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    add_plugin("explorers", "absent", "third_party_nowhere:X")
    add_plugin("rewards", "leaver", "third_party_leaver:X")
    add_plugin("losses", "broken", "third_party_broken:X")
    add_plugin("readers", "other", "deux.contracts:Reward")
    checkup, facts, broken = report(check_plugins)
    assert checkup.faults == 0, "nobody asks for them"
    assert len(broken) == 4
    for line, name, error in zip(
        broken,
        ("explorers absent", "rewards leaver", "losses broken", "readers other"),
        ("No module named 'third_party_nowhere'", "no licence", "ZeroDivisionError", "deux.contracts.Reader"),
        strict=True,
    ):
        assert line.startswith(f"{name}: ")
        assert "third-party 0.3" in line
        assert error in line
    assert "frontier" in facts["explorers"], "the others are there"


def test_a_broken_plugin_that_is_asked_for_is_a_fault(add_plugin):
    add_plugin("explorers", "absent", "third_party_nowhere:X")
    checkup, facts, _ = report(check_chosen_plugins, compose(["explore=absent"]))
    assert checkup.faults == 1
    assert facts["model"] == "kbnet"


def test_a_plugin_reports_itself_what_it_lacks(add_plugin, monkeypatch):
    class Needy(Reader):
        lacking = staticmethod(lambda: "it needs a card reader.")

    assert lacking(Needy) == "it needs a card reader."
    assert lacking(Reward) == ""
    monkeypatch.setattr("deux_plugins.losses.sparse_depth.SparseDepth.lacking", lambda: "no points.", raising=False)
    checkup, _, _ = report(check_chosen_plugins, compose(["objective.sparse_depth=1"]))
    assert checkup.as_json()["sections"][0]["faults"] == ["objective.sparse_depth=sparse_depth: no points."]
