"""Settings of PPO, in a separate module so that they do not import stable-baselines3."""

from dataclasses import dataclass

from deux.errors import check_range


@dataclass(frozen=True)
class PPOSettings:
    """Settings of PPO and its episodes.

    Args:
        steps: total number of steps of all environments.
        episode: number of steps in an episode.
        environments: number of environments.
        parallel: whether each environment runs in a separate process; slower on few cores.
        rollout: steps of each environment between two updates.
        batch_size: batch size of the gradient steps.
        epochs: number of passes over each rollout.
        learning_rate: initial learning rate of Adam, which decreases linearly to 0.
        discount: discount factor gamma.
        gae: lambda of the generalised advantage estimation.
        clip: clip range of the probability ratio.
        entropy: weight of the entropy bonus.
        checkpoint: number of updates between two checkpoints.
    """

    steps: int = 500_000
    episode: int = 500
    environments: int = 16
    parallel: bool = False
    rollout: int = 128
    batch_size: int = 512
    epochs: int = 4
    learning_rate: float = 5.0e-4
    discount: float = 0.99
    gae: float = 0.95
    clip: float = 0.2
    entropy: float = 0.01
    checkpoint: int = 10

    def __post_init__(self) -> None:
        for name in ("steps", "episode", "environments", "rollout", "epochs", "checkpoint"):
            check_range(f"explorer_training.{name}", getattr(self, name), 1)
        check_range("explorer_training.learning_rate", self.learning_rate, 0, 1, ends=False)
        for name in ("discount", "gae"):
            check_range(f"explorer_training.{name}", getattr(self, name), 0, 1)
        check_range("explorer_training.clip", self.clip, 0, 1, ends=False)
        check_range("explorer_training.entropy", self.entropy, 0, 1)
        check_range("explorer_training.batch_size", self.batch_size, 2, self.environments * self.rollout)
