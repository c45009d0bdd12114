"""Which installed package an unexpected error comes from."""

import sys
from pathlib import Path

import pytest

from deux.plugin_failures import raised_in
from deux.registry import Registry, registry

CODE = """
from deux.contracts import LossTerm

class Term(LossTerm):
    def __call__(self, inputs):
        return helper(inputs)

def helper(inputs):
    return inputs["nothing"]

def call(function):
    function()
"""


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The file of an installed package with one loss term."""
    (tmp_path / "faulty_terms.py").write_text(CODE)
    metadata = tmp_path / "faulty_terms-0.3.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: faulty-terms\nVersion: 0.3\n")
    (metadata / "entry_points.txt").write_text("[deux.losses]\nfaulty = faulty_terms:Term\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.delitem(sys.modules, "faulty_terms", raising=False)
    found = Registry()
    monkeypatch.setattr("deux.plugin_failures.registry", lambda: found)
    return tmp_path / "faulty_terms.py"


def test_the_innermost_place_of_a_foreign_package_is_named(package: Path) -> None:
    term = Registry().get("losses", "faulty")()
    with pytest.raises(KeyError) as caught:
        term({})
    assert raised_in(caught.value) == f"faulty-terms 0.3, in {package}, line 9"


def test_what_a_package_calls_is_reported_as_its_own(package: Path) -> None:
    import faulty_terms  # type: ignore[import-not-found]

    def fail() -> None:
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError) as caught:
        faulty_terms.call(fail)
    assert raised_in(caught.value) == f"faulty-terms 0.3, in {package}, line 12"


def test_an_error_of_the_programs_own_has_no_such_place(package: Path) -> None:
    with pytest.raises(AttributeError) as caught:
        registry().get("losses", "local_smoothness")()(None)
    assert raised_in(caught.value) is None
