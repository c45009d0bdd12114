"""What is told where Ray is not installed."""

import importlib
import sys

import pytest

from deux.collection.executors import make_executor
from deux.errors import DeuxError


def test_without_ray_the_command_that_installs_it_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "ray", None)
    for name in ("ray_cluster", "ray_execution"):
        monkeypatch.delitem(sys.modules, f"deux.collection.{name}", raising=False)
    with pytest.raises(DeuxError, match=r"^collect\.executor=ray cannot import Ray .*: pip install 'deux\[ray\]'\.$"):
        make_executor("ray", {})
    assert importlib.import_module("deux.collection.local_execution")
