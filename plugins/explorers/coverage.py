"""The coverage explorer: a policy that PPO trained to seek the growth of the known area."""

from pathlib import Path

from deux.policies.learned_explorer import LearnedExplorer


class CoverageExplorer(LearnedExplorer):
    """Seeks the growth of the known area (`deux_plugins.rewards.coverage`).

    Args:
        weights: a policy file of `task=train_explorer`; None for the one that ships with the explorer.
        greedy: whether the likeliest action is taken. Otherwise actions are drawn, as they were in training.
    """

    reward = "coverage"
    shipped_weights = Path(__file__).with_name("weights") / "coverage.safetensors"
