"""The semantic reconstruction explorer: a policy that PPO trained to seek objects, and better views of them."""

from pathlib import Path

from deux.policies.learned_explorer import LearnedExplorer


class SemanticReconstructionExplorer(LearnedExplorer):
    """Seeks objects, and better views of them (`deux_plugins.rewards.semantic_reconstruction`).

    Args:
        weights: a policy file of `task=train_explorer`; None for the one that ships with the explorer.
        greedy: whether the likeliest action is taken. Otherwise actions are drawn, as they were in training.
    """

    reward = "semantic_reconstruction"
    shipped_weights = Path(__file__).with_name("weights") / "semantic_reconstruction.safetensors"
