"""The ceiling: as many target frames as robots collect, with ideal source frames, and no robot."""

import pytest

from deux.contracts import Episode, Explorer, Robot
from deux.errors import DeuxError
from deux.geometry.camera import Camera
from deux.registry import registry
from deux.studies.participants import find_participants


def test_the_ceiling_takes_no_actions() -> None:
    ceiling: Explorer = registry().create("explorers", "viewpoints", {})
    assert not ceiling.needs
    with pytest.raises(DeuxError, match="choose no actions"):
        ceiling.reset(Episode(seed=0, steps=3, camera=Camera(), robot=Robot()))


def test_a_comparison_refuses_the_ceiling_by_name_and_leaves_it_out_otherwise() -> None:
    configured = registry().choose("explorers", {"name": "random"})
    with pytest.raises(DeuxError, match="viewpoints cannot be compared"):
        find_participants(["random", "viewpoints"], configured, has_model=False)
    found = find_participants(None, configured, has_model=False)
    assert "viewpoints" in found.left_out
    assert "viewpoints" not in [choice.name for choice in found.explorers]
