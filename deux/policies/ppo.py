"""Policy training with PPO of stable-baselines3 in the exploration environment."""

from collections.abc import Callable, Mapping
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.logger import configure
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from stable_baselines3.common.vec_env import DummyVecEnv, SubprocVecEnv, VecEnv, VecMonitor, VecNormalize
from torch import Tensor

from deux.environment.exploration_env import ExplorationEnv
from deux.errors import DeuxError
from deux.io.progress import Progress, ignore_progress
from deux.policies.network import FEATURES, MapEncoder, PolicyNetwork
from deux.policies.ppo_settings import PPOSettings
from deux.policies.training_state import CHECKPOINT_FILE, TrainingState, load_training_state, save_training_state


@dataclass
class LearningCurve:
    """Learning curve with one entry for each update, a mean over the latest episodes.

    Args:
        steps: total number of steps of all environments.
        reward: unnormalised sum of the rewards of an episode.
        area: known area of the map at the end of an episode, square metres.
    """

    steps: list[int] = field(default_factory=list)
    reward: list[float] = field(default_factory=list)
    area: list[float] = field(default_factory=list)


@dataclass(frozen=True)
class TrainingResult:
    """Result of a training.

    Args:
        network: the policy network.
        reward_state: learned state of the reward in the first environment.
        curve: the learning curve.
    """

    network: PolicyNetwork
    reward_state: Mapping[str, np.ndarray]
    curve: LearningCurve


def train_policy(
    settings: PPOSettings,
    make_environment: Callable[[], ExplorationEnv],
    seed: int,
    folder: Path,
    progress: Progress = ignore_progress,
) -> TrainingResult:
    """Train a policy, resuming from a checkpoint in the folder if there is one.

    Args:
        settings: settings of PPO.
        make_environment: creates an environment; must be picklable for parallel environments.
        seed: random seed of the initial weights, the episodes and the actions.
        folder: folder of `checkpoint.pt` and of `logs` with TensorBoard and CSV logs.
        progress: callback for the number of steps.

    Raises:
        DeuxError: the checkpoint is damaged or of another network, or the disk is full.
    """
    environments = _vectorised(settings, make_environment)
    try:
        return _train(settings, environments, seed, folder, progress)
    finally:
        environments.close()


def _train(settings: PPOSettings, environments: VecEnv, seed: int, folder: Path, progress: Progress) -> TrainingResult:
    environments.seed(seed)
    # First episodes of different lengths, so that each rollout contains all phases of an episode.
    lengths = np.linspace(0, settings.episode, settings.environments + 1)[1:].astype(int)
    environments.set_options([{"steps": int(length)} for length in lengths])
    normalised = VecNormalize(environments, norm_obs=False, gamma=settings.discount)
    learner = _learner(settings, normalised, seed)
    curve = LearningCurve()
    checkpoint = folder / CHECKPOINT_FILE
    if checkpoint.exists():
        _resume(checkpoint, learner, normalised, curve)
    left = settings.steps - learner.num_timesteps
    if left > 0:
        record = _Record(curve, settings, checkpoint, normalised, progress)
        # One folder for each start, since the logger overwrites its CSV file.
        logs = folder / "logs" / f"from_{learner.num_timesteps}"
        with closing(configure(str(logs), ["csv", "tensorboard"])) as logger:
            learner.set_logger(logger)
            learner.learn(left, callback=record, reset_num_timesteps=False)
    extractor = learner.policy.features_extractor
    assert isinstance(extractor, _Extractor)
    network = PolicyNetwork(_pixels(environments))
    network.encoder.load_state_dict(extractor.encoder.state_dict())
    network.action.load_state_dict(learner.policy.action_net.state_dict())
    return TrainingResult(network.eval(), environments.env_method("reward_state")[0], curve)


def _learner(settings: PPOSettings, environments: VecEnv, seed: int) -> PPO:
    return PPO(
        "MultiInputPolicy",
        environments,
        # The last rollout may exceed the number of steps, which makes the remaining progress negative.
        learning_rate=lambda remaining: settings.learning_rate * max(0.0, remaining),
        n_steps=settings.rollout,
        batch_size=settings.batch_size,
        n_epochs=settings.epochs,
        gamma=settings.discount,
        gae_lambda=settings.gae,
        clip_range=settings.clip,
        ent_coef=settings.entropy,
        policy_kwargs={
            "features_extractor_class": _Extractor,
            "features_extractor_kwargs": {"pixels": _pixels(environments)},
            "net_arch": [],
        },
        seed=seed,
        device="cpu",  # the network is too small to benefit from a GPU
    )


def _pixels(environments: VecEnv) -> int:
    pixels: int = environments.observation_space["near"].shape[-1]  # type: ignore[index]
    return pixels


def _vectorised(settings: PPOSettings, make: Callable[[], ExplorationEnv]) -> VecEnv:
    makers: list[Callable[[], gymnasium.Env[Any, Any]]] = [make] * settings.environments
    vectorised = SubprocVecEnv(makers, "spawn") if settings.parallel else DummyVecEnv(makers)
    return VecMonitor(vectorised, info_keywords=("area_seen",))


def _resume(checkpoint: Path, learner: PPO, normalised: VecNormalize, curve: LearningCurve) -> None:
    state = load_training_state(checkpoint)
    try:
        learner.policy.load_state_dict(state.policy)
        learner.policy.optimizer.load_state_dict(dict(state.optimiser))
        for index, reward in zip(range(normalised.num_envs), state.rewards, strict=True):
            normalised.env_method("load_reward_state", reward, indices=index)
    except (RuntimeError, ValueError, TypeError, AttributeError, LookupError) as error:
        cause = " ".join(str(error).split())
        raise DeuxError(f"{checkpoint} is of another training ({cause}): delete it to train from zero.") from error
    learner.num_timesteps = state.steps
    assert learner.seed is not None
    learner.set_random_seed(learner.seed + state.steps)  # do not repeat the first episodes
    returns = normalised.ret_rms
    returns.mean, returns.var, returns.count = np.array(state.returns[0]), np.array(state.returns[1]), state.returns[2]
    curve.steps, curve.reward, curve.area = state.curve


class _Record(BaseCallback):
    """Callback that records the learning curve and writes the checkpoints."""

    def __init__(
        self, curve: LearningCurve, settings: PPOSettings, checkpoint: Path, normalised: VecNormalize, report: Progress
    ) -> None:
        super().__init__()
        self._curve, self._settings, self._checkpoint = curve, settings, checkpoint
        self._normalised, self._report = normalised, report
        self._updates = 0

    def _on_step(self) -> bool:
        return True

    def _on_rollout_start(self) -> None:
        """Save a checkpoint after the update that has just finished; the last one is saved in `_on_training_end`."""
        if self._updates and self._updates % self._settings.checkpoint == 0:
            self._save()

    def _on_rollout_end(self) -> None:
        self._updates += 1
        episodes = self.model.ep_info_buffer
        # The first episodes are shortened, so that their sums are not comparable.
        whole = [episode for episode in episodes or () if episode["l"] == self._settings.episode]
        if whole:
            self._curve.steps.append(self.num_timesteps)
            self._curve.reward.append(float(np.mean([episode["r"] for episode in whole])))
            self._curve.area.append(float(np.mean([episode["area_seen"] for episode in whole])))
            self.logger.record("rollout/area_seen", self._curve.area[-1])
        self._report("explorer training", min(self.num_timesteps, self._settings.steps), self._settings.steps)

    def _on_training_end(self) -> None:
        self._save()

    def _save(self) -> None:
        learner, returns = self.model, self._normalised.ret_rms
        state = TrainingState(
            policy=learner.policy.state_dict(),
            optimiser=learner.policy.optimizer.state_dict(),
            steps=self.num_timesteps,
            returns=(float(returns.mean), float(returns.var), float(returns.count)),
            rewards=self._normalised.env_method("reward_state"),
            curve=(self._curve.steps, self._curve.reward, self._curve.area),
        )
        save_training_state(self._checkpoint, state)


class _Extractor(BaseFeaturesExtractor):
    """Features extractor of stable-baselines3 with a `MapEncoder`."""

    def __init__(self, observation_space: gymnasium.Space[Any], pixels: int) -> None:
        super().__init__(observation_space, FEATURES)
        self.encoder = MapEncoder(pixels)

    def forward(self, observations: dict[str, Tensor]) -> Tensor:
        features: Tensor = self.encoder(observations)
        return features
