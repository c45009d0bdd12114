"""Makes the helper modules of this folder importable by name; what several of its tests look at."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))

from compared_episodes import episode
from judged_walks import scene

from deux.studies.explorer_comparison import ExplorerComparison
from deux.studies.uncertainty_study import UncertaintyStudy


@pytest.fixture
def study() -> UncertaintyStudy:
    """Two scenes; `flip` was asked for and has no value anywhere."""
    return UncertaintyStudy([scene("a", 1.0, 0.6), scene("b", 1.0, 0.8)], ("l1", "sparse_error", "parallax", "flip"))


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
