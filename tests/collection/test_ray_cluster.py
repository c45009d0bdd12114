"""What is told where Ray is not installed, or does not start."""

import importlib
import sys

import pytest

from deux.collection.executors import make_executor
from deux.errors import DeuxError


def test_without_ray_the_command_that_installs_it_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "ray", None)
    for name in ("ray_cluster", "ray_execution"):
        monkeypatch.delitem(sys.modules, f"deux.collection.{name}", raising=False)
    with pytest.raises(DeuxError, match=r"^collect\.executor=ray cannot import Ray .*: pip install 'deux\[ray\]'\.$"):
        make_executor("ray", {})
    assert importlib.import_module("deux.collection.local_execution")


def test_where_ray_does_not_start_the_way_without_it_is_named(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    ray = pytest.importorskip("ray")
    ray_cluster = importlib.import_module("deux.collection.ray_cluster")

    def busy(*_: object, **__: object) -> None:
        raise Exception("The current node timed out during startup. This could happen because of anything.")

    monkeypatch.setattr(ray, "init", busy)
    with (
        pytest.raises(
            DeuxError, match=r"^Ray does not start: The current node timed out during startup; collect\.proc"
        ),
        ray_cluster.connected(None),
    ):
        pass
    assert [record.levelname for record in caplog.records] == ["WARNING", "WARNING"]  # it takes half a minute each
