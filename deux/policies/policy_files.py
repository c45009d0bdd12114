"""Policy files: a trained policy as safetensors, its training in the header. Reading one executes no code."""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save

from deux.environment.egocentric import Crops
from deux.errors import DeuxError, check_range
from deux.io.atomic import write_atomically
from deux.policies.network import PolicyNetwork

POLICY_FILE = "policy.safetensors"
"""Its name in a run folder."""

_POLICY, _REWARD = "policy.", "reward."


@dataclass(frozen=True)
class TrainedPolicy:
    """A trained policy, what it observes, and how it was trained.

    Args:
        network: the policy, in evaluation mode.
        crops: what it sees of the map.
        resolution: edge of the map's cells in metres.
        reward_state: what its reward learned in training; empty for most.
        made_by: reward, options, seeds, number of steps and learning curve of the training.
    """

    network: PolicyNetwork
    crops: Crops
    resolution: float
    reward_state: Mapping[str, np.ndarray]
    made_by: Mapping[str, Any]


def save_policy(path: Path, policy: TrainedPolicy) -> None:
    """Write a policy file, whole or not at all; weights are kept in half precision.

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
        DeuxError: there is no such file, or it is no policy file.
    """
    _check_present(path)
    try:
        with safe_open(path, "np") as file:
            header = json.loads((file.metadata() or {})["deux_policy"])
            tensors = {name: file.get_tensor(name).astype(np.float32) for name in file.keys()}  # noqa: SIM118
        check_range("resolution", header["resolution"], 0.0, ends=False)
        crops = Crops(**header["crops"])
        network = PolicyNetwork(crops.pixels)
        network.load_state_dict({name: torch.from_numpy(value) for name, value in _under(_POLICY, tensors).items()})
        return TrainedPolicy(
            network.eval(), crops, float(header["resolution"]), _under(_REWARD, tensors), header["made_by"]
        )
    except (SafetensorError, DeuxError, LookupError, TypeError, ValueError, RuntimeError) as error:
        cause = " ".join(str(error).split()).rstrip(".")
        raise DeuxError(f"{path} is no policy file as task=train_explorer writes it ({cause}).") from error


def policy_identity(path: Path) -> str:
    """The first sixteen hexadecimal digits of a policy file's SHA-256.

    Raises:
        DeuxError: there is no such file.
    """
    _check_present(path)
    return hashlib.sha256(path.read_bytes()).hexdigest()[:16]


def _check_present(path: Path) -> None:
    if not path.is_file():
        raise DeuxError(
            f"there is no policy file {path}: task=train_explorer makes one, {POLICY_FILE} in its run folder."
        )


def _under(prefix: str, tensors: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    return {name.removeprefix(prefix): value for name, value in tensors.items() if name.startswith(prefix)}
