"""The presets `experiment=published_<model>`: their objectives reproduce the recorded totals of the cases."""

import pytest
from omegaconf import OmegaConf

from deux.configuration import compose
from deux.registry import registry
from deux.training.objective import make_objective
from deux.training.pose_source import RelativePoses


def losses_of(name, published_case):
    """What the preset's objective makes of the recorded case, and the recorded values."""
    cfg = compose([f"experiment=published_{name}"])
    assert cfg.model.name == name
    objective = make_objective(registry().create("depth_models", name, {}), OmegaConf.to_container(cfg.objective))
    inputs, recorded = published_case(name)
    poses = None
    if objective.needs_reconstructions:
        poses = RelativePoses(inputs.reconstructions.source_from_target, inputs.reconstructions.target_from_source)
    return objective(inputs.batch, inputs.prediction, poses), recorded


@pytest.mark.parametrize("name", ["kbnet", "voiced", "scaffnet"])
def test_the_total_is_the_recorded_one(published_case, name):
    losses, recorded = losses_of(name, published_case)
    assert float(losses.total) == pytest.approx(recorded["total"], rel=1e-4)


def test_fusionnets_total_but_for_the_prior(published_case):
    """The published prior's term is wrong in a batch of two: tests/plugins/losses/test_topology_prior.py."""
    losses, recorded = losses_of("fusionnet", published_case)
    ours_in_place_of_theirs = 0.10 * (float(losses.terms["topology_prior"]) - recorded["prior_depth"])
    assert float(losses.total) == pytest.approx(recorded["total"] + ours_in_place_of_theirs, rel=1e-4)


@pytest.mark.parametrize(("name", "last_epochs"), [("kbnet", 5), ("voiced", 10), ("fusionnet", 10), ("scaffnet", 6)])
def test_the_schedule_halves_the_rate_for_the_last_epochs(name, last_epochs):
    training = compose([f"experiment=published_{name}"]).training
    assert (training.learning_rate, training.unit, list(training.factors)) == (1e-4, "epoch", [0.5])
    assert training.epochs - training.boundaries[0] == last_epochs
    assert training.steps is None
