"""Checkpoints of policy training. Loading one executes no code."""

import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
import torch

from deux.errors import DeuxError
from deux.io.atomic import write_atomically
from deux.io.torch_files import read_torch

CHECKPOINT_FILE = "checkpoint.pt"
"""Name of the checkpoint in a run folder."""


@dataclass(frozen=True)
class TrainingState:
    """State from which training resumes; unfinished episodes are restarted.

    Args:
        policy: state dictionary of the stable-baselines3 policy.
        optimiser: state dictionary of Adam.
        steps: total number of steps of all environments.
        returns: mean, variance and count of the discounted returns, for reward normalisation.
        rewards: learned state of each environment's reward.
        curve: steps, rewards and areas of the learning curve.
    """

    policy: Mapping[str, Any]
    optimiser: Mapping[str, Any]
    steps: int
    returns: tuple[float, float, float]
    rewards: Sequence[Mapping[str, np.ndarray]]
    curve: tuple[list[int], list[float], list[float]]


def save_training_state(path: Path, state: TrainingState) -> None:
    """Write a checkpoint atomically."""
    content = {field.name: getattr(state, field.name) for field in fields(state)}
    content["rewards"] = [{name: torch.tensor(value) for name, value in reward.items()} for reward in state.rewards]
    buffer = io.BytesIO()
    torch.save(content, buffer)
    write_atomically(path, buffer.getvalue())


def load_training_state(path: Path) -> TrainingState:
    """Read a checkpoint.

    Raises:
        DeuxError: the checkpoint is damaged.
    """
    try:
        content = read_torch(path)
        content["rewards"] = [{name: value.numpy() for name, value in reward.items()} for reward in content["rewards"]]
        state = TrainingState(**content)
        if type(state.steps) is not int or not isinstance(state.policy, Mapping):
            raise ValueError("its steps are not an integer, or its policy is not a dictionary")
        if not isinstance(state.optimiser, Mapping) or len(state.returns) != 3 or len(state.curve) != 3:
            raise ValueError("its optimiser is not a dictionary, or its returns or curve do not have three values")
        return state
    except Exception as error:  # values of an arbitrary file may have any type
        cause = " ".join(str(error).split()[:20]) or type(error).__name__
        raise DeuxError(f"{path} is damaged ({cause}): delete it to train from zero.") from error
