"""The smooth coverage explorer: a policy that PPO trained to seek parts of the map that it has seldom seen."""

from pathlib import Path

from deux.policies.learned_explorer import LearnedExplorer


class SmoothCoverageExplorer(LearnedExplorer):
    """Seeks parts of the map that it has seldom seen (`deux_plugins.rewards.smooth_coverage`).

    Args:
        weights: a policy file of `task=train_explorer`; None for the one that ships with the explorer.
        greedy: whether the likeliest action is taken. Otherwise actions are drawn, as they were in training.
    """

    reward = "smooth_coverage"
    shipped_weights = Path(__file__).with_name("weights") / "smooth_coverage.safetensors"
