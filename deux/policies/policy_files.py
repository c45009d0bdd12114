"""Policy files: weights as safetensors, with metadata in the header. Loading one executes no code."""

import hashlib
import json
import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from safetensors import safe_open
from safetensors.numpy import save

from deux.deployment.model_files import misfit
from deux.environment.egocentric import Crops
from deux.errors import DeuxError, check_range, error_text
from deux.inference.weightless import without_weights
from deux.io.atomic import write_atomically
from deux.io.json_files import checked_object, checked_record, decode_json
from deux.memory_budget import check_memory
from deux.options import converted
from deux.policies.network import PolicyNetwork

POLICY_FILE = "policy.safetensors"
"""Name of the policy file in a run folder."""

_POLICY, _REWARD = "policy.", "reward."


@dataclass(frozen=True)
class TrainedPolicy:
    """A trained policy with the parameters of its observations and its training.

    Args:
        network: the policy network in evaluation mode.
        crops: sizes of the map crops.
        resolution: edge of the map cells in metres.
        reward_state: learned state of the reward; empty for most rewards.
        made_by: reward, options, seeds, number of steps and learning curve of the training.
    """

    network: PolicyNetwork
    crops: Crops
    resolution: float
    reward_state: Mapping[str, np.ndarray]
    made_by: Mapping[str, Any]


def save_policy(path: Path, policy: TrainedPolicy) -> None:
    """Write a policy file atomically, with weights in half precision.

    Raises:
        DeuxError: the disk is full or not writable.
    """
    tensors = {_POLICY + name: value.numpy() for name, value in policy.network.state_dict().items()}
    tensors |= {_REWARD + name: value for name, value in policy.reward_state.items()}
    header = {"crops": asdict(policy.crops), "resolution": policy.resolution, "made_by": policy.made_by}
    halves = {name: np.ascontiguousarray(value, dtype=np.float16) for name, value in tensors.items()}
    write_atomically(path, save(halves, {"deux_policy": json.dumps(header)}))


def load_policy(path: Path) -> TrainedPolicy:
    """Read a policy file.

    Raises:
        DeuxError: the file is missing or not a policy file.
    """
    _check_present(path)
    try:
        check_memory(4 * path.stat().st_size, str(path), "it is larger than any policy")
        with safe_open(path, "np") as file:
            header = checked_object(decode_json((file.metadata() or {})["deux_policy"].encode(), path), path)
            tensors = {name: file.get_tensor(name).astype(np.float32) for name in file.keys()}  # noqa: SIM118
        resolution = converted(header["resolution"], float, "resolution")
        check_range("resolution", resolution, 0.0, ends=False)
        crops = checked_record(header["crops"], Crops, "crops")
        if broken := [name for name, value in tensors.items() if not np.isfinite(value).all()]:
            raise ValueError(f"{broken[0]} contains NaN or infinity")
        weights = {name: torch.from_numpy(value) for name, value in _under(_POLICY, tensors).items()}
        with without_weights():  # detects an absurd number of pixels before memory is allocated
            if problem := misfit(PolicyNetwork(crops.pixels), weights):
                raise ValueError(f"it {problem}")
        network = PolicyNetwork(crops.pixels)
        network.load_state_dict(weights)
        return TrainedPolicy(network.eval(), crops, resolution, _under(_REWARD, tensors), header["made_by"])
    except Exception as error:  # values of an arbitrary file may have any type
        raise DeuxError(f"{path} is not a policy file of task=train_explorer ({error_text(error)}).") from error


def policy_identity(path: Path) -> str:
    """First sixteen hexadecimal digits of a policy file's SHA-256.

    Raises:
        DeuxError: the file is missing.
    """
    _check_present(path)
    return hashlib.sha256(path.read_bytes()).hexdigest()[:16]


def _check_present(path: Path) -> None:
    if not os.path.isfile(path):
        raise DeuxError(
            f"there is no policy file {path}: task=train_explorer makes one, {POLICY_FILE} in its run folder."
        )


def _under(prefix: str, tensors: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    return {name.removeprefix(prefix): value for name, value in tensors.items() if name.startswith(prefix)}
