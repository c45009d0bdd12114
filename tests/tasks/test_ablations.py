"""The switches of docs/ablations.md: each can be set, and becomes a row of the report and not another table."""

import pytest

from deux.configuration import compose, sections_of
from deux.registry import registry
from deux.report.conditions import Conditions, conditions

SWITCHES = {
    "explore.residual_pose": ("surface", "pose", "constant"),
    "collect.uncertainty": (
        "sparse_error",
        *(name for name in registry().names("uncertainties") if name != "sparse_error"),
    ),
    "explore.map_depth": ("predicted", "sensor"),
    "explore.depth_error": ("null", "0.1"),
    "explore.target": ("informative", "sampled", "greedy"),
    "explore.per_action": ("true", "false"),
    "explore.keep_targets": ("false", "true"),
    "explore.least_way": ("1.5", "0.0"),
    "explore.guidance": ("2.0", "1.0"),
    "explore.view_guidance": ("1.0", "0.5", "0.0"),
    "explore.revisits": ("true", "false"),
    "explore.on_the_way": ("true", "false"),
    "explore.temperature": ("0.1", "0.25", "1.0"),
    "collect.correct_depth": ("true", "false"),
    "collect.remembered_frames": ("30", "0"),
    "seed_model.checkpoint": ("kbnet-indoor", "somewhere/model.safetensors", "null"),
    "callbacks": ("[]", "[active_collection]"),
}


SEED_TRAINING = {
    "seed_model.explore": ("random", "frontier"),
    "seed_model.steps": ("300", "600"),
    "seed_model.source": ("null", "apartments"),
    "seed_model.scenes": ("8", "4"),
}


def composed(*overrides: str) -> Conditions:
    return conditions(sections_of(compose(overrides)).identity)


@pytest.mark.parametrize("option", SWITCHES)
def test_a_switch_makes_another_explorer_of_the_same_training(option):
    made = [composed(f"{option}={value}") for value in SWITCHES[option]]
    assert made[0] == conditions(sections_of(compose()).identity)  # the first value is the default
    assert len({one.explorer_options for one in made}) == len(SWITCHES[option])
    assert len({(one.training, one.testing, one.model_options) for one in made}) == 1


@pytest.mark.parametrize("option", SEED_TRAINING)
def test_how_a_seed_model_is_trained_counts_only_where_it_is(option):
    values = SEED_TRAINING[option]
    trained = {composed("seed_model.checkpoint=null", f"{option}={value}").explorer_options for value in values}
    given = {composed(f"{option}={value}").explorer_options for value in values}
    assert (len(trained), len(given)) == (2, 1)
