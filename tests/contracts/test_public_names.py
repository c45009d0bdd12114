"""What `from deux.contracts import ...` offers, and what it imports."""

import subprocess
import sys

import pytest

import deux.contracts


def test_every_public_name_can_be_imported() -> None:
    assert dir(deux.contracts) == sorted(deux.contracts.__all__)
    for name in deux.contracts.__all__:
        assert getattr(deux.contracts, name) is not None
    with pytest.raises(AttributeError, match="Nothing"):
        deux.contracts.Nothing  # noqa: B018


@pytest.mark.parametrize(
    "module",
    ["explorers.deux", "explorers.oracle", "readers.rgbd_folder", "rewards.novelty", "scenes.houses", "scenes.hm3d"],
)
def test_plugins_that_need_no_network_do_not_import_torch(module: str) -> None:
    """Its import takes seconds, which each process that makes scenes, renders or reads frames would wait for."""
    code = f"import sys, deux_plugins.{module}; sys.exit('torch' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False, timeout=120).returncode == 0
