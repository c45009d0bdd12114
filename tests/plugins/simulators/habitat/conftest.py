"""Fixtures of the tests of the adapter to Habitat-Sim: a stand-in for its package, and rooms that it can load."""

import importlib.util
import json
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any, Literal

import pytest

from deux.contracts import SceneReference


def _load(name: str, file: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(name, Path(__file__).with_name(file))
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)
    return module


_load("habitat_stand_in_room", "stand_in_room.py")
STAND_IN = _load("habitat_stand_in", "stand_in.py")

BOXES = [
    {"low": [2.0, 0.0, 1.0], "high": [2.6, 0.8, 1.8], "category": "table"},
    {"low": [4.2, 0.0, 2.9], "high": [5.2, 0.5, 3.9], "category": "bed"},
    {"low": [0.0, 0.0, 3.2], "high": [0.5, 2.0, 4.4], "category": "cabinet"},
    {"low": [3.0, 0.0, 4.6], "high": [3.4, 0.9, 5.0], "category": "table"},
]


@dataclass(frozen=True)
class RoomReference(SceneReference):
    """A scene in a file that only the stand-in can read."""

    path: Path
    axis: Literal["y", "z"] = "y"

    @property
    def identity(self) -> str:
        return f"room:{self.path}"

    @property
    def file(self) -> Path:
        return self.path

    @property
    def up(self) -> Literal["y", "z"]:
        return self.axis


@pytest.fixture
def install(monkeypatch: pytest.MonkeyPatch) -> Callable[..., ModuleType]:
    """A function that puts a stand-in in place of habitat_sim; its arguments are those of `make_habitat_sim`."""

    def put(**arguments: Any) -> ModuleType:
        module: ModuleType = STAND_IN.make_habitat_sim(**arguments)
        monkeypatch.setitem(sys.modules, "habitat_sim", module)
        monkeypatch.setattr("torch.cuda.is_available", lambda: False)
        return module

    return put


@pytest.fixture(scope="session")
def make_room(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., RoomReference]:
    """A function that writes a room of 6 m x 5 m with four boxes and returns its reference.

    `annotation` is the pair of suffixes of the semantic mesh and its description, for a room that has them.
    """

    def make(up: Literal["y", "z"] = "y", annotation: tuple[str, str] | None = None, **reference: Any) -> RoomReference:
        path = tmp_path_factory.mktemp("room") / "room.glb"
        path.write_text(json.dumps({"size": [6.0, 2.5, 5.0], "up": up, "boxes": BOXES}))
        for suffix in annotation or ():
            path.with_name("room" + suffix).touch()
        return RoomReference("room", path, up, **reference)

    return make


@pytest.fixture
def boxes() -> list[dict[str, Any]]:
    """What stands in the room of `make_room`: boxes with `low`, `high` and `category`."""
    return BOXES
