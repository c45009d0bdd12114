"""The curiosity explorer: a policy that PPO trained to seek what its forward model does not foresee."""

from pathlib import Path

from deux.policies.learned_explorer import LearnedExplorer


class CuriosityExplorer(LearnedExplorer):
    """Seeks what its forward model does not foresee (`deux_plugins.rewards.curiosity`).

    Args:
        weights: a policy file of `task=train_explorer`; None for the one that ships with the explorer.
        greedy: whether the likeliest action is taken. Otherwise actions are drawn, as they were in training.
    """

    reward = "curiosity"
    shipped_weights = Path(__file__).with_name("weights") / "curiosity.safetensors"
