"""The reference cases: published checkpoints with every tensor filled by rule, and what the networks make of them."""

import json
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor


def filled(group: str, key: str, shape: list[int], seed: int) -> Tensor:
    """The tensor `key` (without `module.`) of a sub-dictionary, by the rule of cases/README.md."""
    if key.endswith("num_batches_tracked"):
        return torch.tensor(0)
    random = np.random.RandomState((zlib.crc32(f"{group}/{key}".encode()) + seed) % 2**32)
    n = random.standard_normal(int(np.prod(shape))).reshape(shape)
    if key.endswith("running_var"):
        n = 1 + 0.1 * abs(n)
    elif key.endswith(("running_mean", "bias")):
        n = 0.1 * n
    elif len(shape) == 1:
        n = 1 + 0.1 * n
    else:
        n = n * np.sqrt(2 / (np.prod(shape[1:]) + shape[0] * np.prod(shape[2:])))
    return torch.from_numpy(n.astype(np.float32))


@dataclass(frozen=True)
class PublishedCase:
    """One reference case.

    Args:
        arrays: inputs and outputs of the published network.
        seed: seed of the weights.
        keys: names and shapes of the tensors of each sub-dictionary.
    """

    arrays: dict[str, Tensor]
    seed: int
    keys: dict[str, list[tuple[str, list[int]]]]

    def checkpoint(self, pose: bool = False, prefix: str = "module.") -> dict[str, Any]:
        """What the published file holds, or that of the pose network; every name begins with `prefix`."""
        checkpoint: dict[str, Any] = {"train_step": 1, "optimizer_state_dict": {"state": {}}}
        for group, tensors in self.keys.items():
            if group.startswith("pose/") == pose:
                names = [(key.removeprefix("module."), shape) for key, shape in tensors]
                state = {prefix + key: filled(group, key, shape, self.seed) for key, shape in names}
                checkpoint[group.removeprefix("pose/")] = state
        return checkpoint


@pytest.fixture
def published_case(shared_data: Callable[[str], Path]) -> Callable[[str], PublishedCase]:
    """A function from a case's name to the case; it skips the test where the cases are absent."""

    def read(name: str) -> PublishedCase:
        folder = shared_data("cases")
        spec = json.loads((folder / f"{name}.json").read_text())
        with np.load(folder / f"{name}.npz", allow_pickle=False) as file:
            arrays = {key: torch.from_numpy(file[key]) for key in file.files}
        return PublishedCase(arrays, spec["seed"], spec["keys"])

    return read
