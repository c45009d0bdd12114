"""The learned explorers: policies trained by PPO (`task=train_explorer`), each for its own reward."""

from pathlib import Path

from deux.policies.learned_explorer import LearnedExplorer

WEIGHTS = Path(__file__).with_name("weights")
"""The folder of the policy files that ship with the explorers."""


class CoverageExplorer(LearnedExplorer):
    """Maximises the growth of the known area (`deux_plugins.rewards.coverage`).

    Args:
        weights: a policy file from `task=train_explorer`; None for the one that ships with the explorer.
        greedy: take the most likely action instead of sampling from the policy, as in training.
    """

    reward = "coverage"
    shipped_weights = WEIGHTS / "coverage.safetensors"


class SmoothCoverageExplorer(LearnedExplorer):
    """Seeks parts of the map that it has rarely seen (`deux_plugins.rewards.coverage`).

    Args:
        weights: a policy file from `task=train_explorer`; None for the one that ships with the explorer.
        greedy: take the most likely action instead of sampling from the policy, as in training.
    """

    reward = "smooth_coverage"
    shipped_weights = WEIGHTS / "smooth_coverage.safetensors"


class NoveltyExplorer(LearnedExplorer):
    """Seeks places where it has rarely been (`deux_plugins.rewards.novelty`).

    Args:
        weights: a policy file from `task=train_explorer`; None for the one that ships with the explorer.
        greedy: take the most likely action instead of sampling from the policy, as in training.
    """

    reward = "novelty"
    shipped_weights = WEIGHTS / "novelty.safetensors"


class CuriosityExplorer(LearnedExplorer):
    """Seeks observations that its forward model does not predict (`deux_plugins.rewards.curiosity`).

    Args:
        weights: a policy file from `task=train_explorer`; None for the one that ships with the explorer.
        greedy: take the most likely action instead of sampling from the policy, as in training.
    """

    reward = "curiosity"
    shipped_weights = WEIGHTS / "curiosity.safetensors"


class SemanticReconstructionExplorer(LearnedExplorer):
    """Seeks objects, and better views of them (`deux_plugins.rewards.semantic_reconstruction`).

    Args:
        weights: a policy file from `task=train_explorer`; None for the one that ships with the explorer.
        greedy: take the most likely action instead of sampling from the policy, as in training.
    """

    reward = "semantic_reconstruction"
    shipped_weights = WEIGHTS / "semantic_reconstruction.safetensors"
