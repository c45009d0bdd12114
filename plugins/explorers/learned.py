"""The learned explorers: policies that PPO trained (`task=train_explorer`), each with a reward of its own."""

from pathlib import Path

from deux.policies.learned_explorer import LearnedExplorer

WEIGHTS = Path(__file__).with_name("weights")
"""The folder of the policy files that ship with the explorers."""


class CoverageExplorer(LearnedExplorer):
    """Seeks the growth of the known area (`deux_plugins.rewards.coverage`).

    Args:
        weights: a policy file of `task=train_explorer`; None for the one that ships with the explorer.
        greedy: whether the likeliest action is taken. Otherwise actions are drawn, as they were in training.
    """

    reward = "coverage"
    shipped_weights = WEIGHTS / "coverage.safetensors"


class SmoothCoverageExplorer(LearnedExplorer):
    """Seeks parts of the map that it has seldom seen (`deux_plugins.rewards.coverage`).

    Args:
        weights: a policy file of `task=train_explorer`; None for the one that ships with the explorer.
        greedy: whether the likeliest action is taken. Otherwise actions are drawn, as they were in training.
    """

    reward = "smooth_coverage"
    shipped_weights = WEIGHTS / "smooth_coverage.safetensors"


class NoveltyExplorer(LearnedExplorer):
    """Seeks places where it has seldom been (`deux_plugins.rewards.novelty`).

    Args:
        weights: a policy file of `task=train_explorer`; None for the one that ships with the explorer.
        greedy: whether the likeliest action is taken. Otherwise actions are drawn, as they were in training.
    """

    reward = "novelty"
    shipped_weights = WEIGHTS / "novelty.safetensors"


class CuriosityExplorer(LearnedExplorer):
    """Seeks what its forward model does not foresee (`deux_plugins.rewards.curiosity`).

    Args:
        weights: a policy file of `task=train_explorer`; None for the one that ships with the explorer.
        greedy: whether the likeliest action is taken. Otherwise actions are drawn, as they were in training.
    """

    reward = "curiosity"
    shipped_weights = WEIGHTS / "curiosity.safetensors"


class SemanticReconstructionExplorer(LearnedExplorer):
    """Seeks objects, and better views of them (`deux_plugins.rewards.semantic_reconstruction`).

    Args:
        weights: a policy file of `task=train_explorer`; None for the one that ships with the explorer.
        greedy: whether the likeliest action is taken. Otherwise actions are drawn, as they were in training.
    """

    reward = "semantic_reconstruction"
    shipped_weights = WEIGHTS / "semantic_reconstruction.safetensors"
