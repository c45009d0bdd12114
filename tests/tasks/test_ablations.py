"""The switches of docs/ablations.md: each can be set, and becomes a row of the report and not another table."""

import pytest

from deux.configuration import compose
from deux.report.conditions import Conditions, conditions
from deux.tasks.settings import Settings
from deux.uncertainty.measures import MEASURES

SWITCHES = {
    "explore.residual_pose": ("pose", "surface"),
    "collect.uncertainty": tuple(MEASURES),
    "explore.map_depth": ("predicted", "sensor"),
    "explore.target": ("sampled", "greedy"),
    "explore.temperature": ("0.25", "1.0"),
    "seed.explore": ("random", "frontier"),
    "seed.steps": ("300", "600"),
    "seed.checkpoint": ("null", "somewhere/model.safetensors"),
    "callbacks": ("none", "active_collection"),
}


def composed(override: str) -> Conditions:
    return conditions(Settings(compose([override])).identity)


@pytest.mark.parametrize("option", SWITCHES)
def test_a_switch_makes_another_explorer_of_the_same_training(option):
    made = [composed(f"{option}={value}") for value in SWITCHES[option]]
    assert made[0] == conditions(Settings(compose()).identity)  # the first value is the default
    assert len({one.explorer_options for one in made}) == len(SWITCHES[option])
    assert len({(one.training, one.testing, one.model_options) for one in made}) == 1
