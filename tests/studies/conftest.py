"""Makes the helper modules here and in tests/collection importable by name; what several of its tests look at."""

import functools
import sys
from pathlib import Path
from typing import Any

import pytest

sys.path.insert(0, str(Path(__file__).parent))
sys.path.insert(0, str(Path(__file__).parents[1] / "collection"))

from box_scenes import BoxRoomSimulator
from compared_episodes import episode
from evaluated_walks import walk

from deux.contracts import Floor
from deux.studies.explorer_comparison import ExplorerComparison
from deux.studies.uncertainty_study import UncertaintyStudy
from deux.testing.box_world import BoxWorld


@pytest.fixture
def study() -> UncertaintyStudy:
    """Two scenes; `flip` was asked for and has no value anywhere."""
    return UncertaintyStudy([walk("a", 1.0, 0.6), walk("b", 1.0, 0.8)], ("l1", "sparse_error", "parallax", "flip"))


@pytest.fixture
def comparison() -> ExplorerComparison:
    """Two scenes that differ more than the two explorers do; two episodes of `still` in the first scene."""
    episodes = [
        episode("still", "small", 9.0),
        episode("still", "small", 11.0, number=1),
        episode("still", "large", 30.0),
        episode("eager", "small", 13.0, collisions=0),
        episode("eager", "large", 33.5, collisions=1),
    ]
    return ExplorerComparison(episodes, {"eager": "growth"})


@pytest.fixture
def two_floors(monkeypatch: pytest.MonkeyPatch) -> None:
    """Lets `BoxRoomSimulator` have two floors that are alike, as `BoxWorld` has one."""
    make = BoxRoomSimulator.__init__

    @functools.wraps(make)
    def make_two(self: BoxRoomSimulator, *given: Any, **options: Any) -> None:
        make(self, *given, **options)
        self.floors = (Floor(0.0, 16.0), Floor(3.0, 16.0))

    monkeypatch.setattr(BoxRoomSimulator, "__init__", make_two)
    monkeypatch.setattr(BoxWorld, "_check_floor", lambda self, floor: None)
