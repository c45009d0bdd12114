"""The novelty explorer: a policy that PPO trained to seek places where it has seldom been."""

from pathlib import Path

from deux.policies.learned_explorer import LearnedExplorer


class NoveltyExplorer(LearnedExplorer):
    """Seeks places where it has seldom been (`deux_plugins.rewards.novelty`).

    Args:
        weights: a policy file of `task=train_explorer`; None for the one that ships with the explorer.
        greedy: whether the likeliest action is taken. Otherwise actions are drawn, as they were in training.
    """

    reward = "novelty"
    shipped_weights = Path(__file__).with_name("weights") / "novelty.safetensors"
