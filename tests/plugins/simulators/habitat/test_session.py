import sys
from collections.abc import Callable
from types import ModuleType

import pytest

from deux.errors import DeuxError
from deux_plugins.simulators.habitat import session
from deux_plugins.simulators.habitat.session import choose_device, import_habitat


def test_a_missing_package_gets_the_conda_command(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "habitat_sim", None)
    with pytest.raises(DeuxError, match="conda install habitat-sim headless -c conda-forge -c aihabitat"):
        import_habitat()


def test_the_error_about_a_broken_package_names_what_it_needs(monkeypatch: pytest.MonkeyPatch, tmp_path) -> None:
    (tmp_path / "habitat_sim.py").write_text("import a_package_that_nobody_has")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "habitat_sim", raising=False)
    with pytest.raises(DeuxError, match="it needs a_package_that_nobody_has, which is not installed"):
        import_habitat()


@pytest.mark.parametrize("version", ["0.2.4", "0.1.7"])
def test_an_old_package_is_refused(version: str, install: Callable[..., ModuleType]) -> None:
    install(version=version)
    with pytest.raises(DeuxError, match=f"version {version}: simulator=habitat needs 0.2.5 or later"):
        import_habitat()


@pytest.mark.parametrize("version", ["0.2.5", "0.3.3", "0.3.4.dev0", "0.3.3rc1"])
def test_a_package_that_will_do_is_taken(version: str, install: Callable[..., ModuleType]) -> None:
    module = install(version=version)
    assert import_habitat() is module


def test_the_card_is_pytorchs_and_none_where_it_sees_none(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("torch.cuda.is_available", lambda: False)
    assert choose_device(None) == -1
    monkeypatch.setattr("torch.cuda.is_available", lambda: True)
    monkeypatch.setattr("torch.cuda.current_device", lambda: 1)
    assert choose_device(None) == 1


def test_a_card_that_is_not_there_is_refused_before_it_ends_the_process(
    monkeypatch: pytest.MonkeyPatch, tmp_path
) -> None:
    monkeypatch.setattr("torch.cuda.device_count", lambda: 0)
    monkeypatch.setattr(session, "NVIDIA_CARDS", tmp_path)
    with pytest.raises(DeuxError, match=r"simulator\.gpu is 0: there is no Nvidia card"):
        choose_device(0)
    (tmp_path / "0000:65:00.0").mkdir()
    assert choose_device(0) == 0, "PyTorch may be built without CUDA"
    with pytest.raises(DeuxError, match="the cards are 0 to 0,"):
        choose_device(1)
    with pytest.raises(DeuxError, match=r"simulator\.gpu is -2"):
        choose_device(-2)
