"""The weights that count as part of a run: those that its command names and uses."""

import pytest

from deux.configuration import compose, sections_of
from deux.policies.policy_files import policy_identity
from deux.tasks.checkpoints import weights_identity
from deux.tasks.named_weights import named_weights
from deux_plugins.explorers.learned import CoverageExplorer

FUSIONNET = "model=fusionnet"


@pytest.fixture
def found(model_file):
    """The options whose weights count, for overrides and stages; all name the same file."""

    def find(*overrides, **stages):
        file = model_file("kbnet")
        named = [f"{option}={file}" for option in ("seed_model.checkpoint", "training.start", "foundation.checkpoint")]
        weights = named_weights(sections_of(compose(["task=train", *named, *overrides])), **stages)
        policies = {policy_identity(CoverageExplorer.shipped_weights)}
        assert {*weights.values()} <= {weights_identity(file)} | policies
        return sorted(weights)

    return find


def test_only_what_is_used_counts(found):
    assert found("explore=deux") == ["seed_model.checkpoint", "training.start"]
    assert found("explore=deux", trained=False) == ["seed_model.checkpoint"]
    assert found("explore=deux", guide=False) == ["training.start"]
    assert found("explore=random") == ["training.start"]
    policy = f"explore.weights={CoverageExplorer.shipped_weights}"
    assert found("explore=coverage", trained=False) == []
    assert found("explore=coverage", policy, trained=False) == ["explore.weights"]
    assert found("explore=coverage", policy, explorer=False, trained=False) == []


def test_a_foundation_counts_where_something_is_trained_on_it(found):
    on_it = ["foundation.checkpoint"]
    assert found(FUSIONNET, "explore=random", "training.start=null") == on_it
    assert found(FUSIONNET, "explore=random") == ["training.start"]  # the foundation is part of it
    assert found(FUSIONNET, "explore=deux", "seed_model.checkpoint=null", trained=False) == on_it
    assert found(FUSIONNET, "explore=deux", trained=False) == ["seed_model.checkpoint"]
    assert found("model=kbnet", "explore=deux", "seed_model.checkpoint=null", "training.start=null") == []


def test_missing_weights_are_reported_by_whoever_needs_them():
    overrides = ["task=train", "explore=coverage", "explore.weights=nowhere", "training.start=nowhere"]
    assert named_weights(sections_of(compose(overrides))) == {}


def test_a_policy_counts_by_its_file(tmp_path):
    copy = tmp_path / "policy.safetensors"
    sections = sections_of(compose(["task=collect", "explore=coverage", f"explore.weights={copy}"]))
    copy.write_bytes(CoverageExplorer.shipped_weights.read_bytes())
    before = named_weights(sections)
    assert before == {"explore.weights": policy_identity(CoverageExplorer.shipped_weights)}
    copy.write_bytes(copy.read_bytes() + b"\0")
    assert named_weights(sections) != before
