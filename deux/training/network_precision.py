"""`trainer.precision=64-true` and `bf16-true`: the networks in another precision, everything else in float32."""

from collections.abc import Iterator
from contextlib import AbstractContextManager, nullcontext
from typing import Any, Literal

import torch
from lightning.pytorch.plugins import Precision
from torch import Tensor, nn

from deux.errors import DeuxError

NetworkPrecisionName = Literal["bf16-true", "64-true"]

_DTYPES: dict[str, torch.dtype] = {"bf16-true": torch.bfloat16, "64-true": torch.float64}
_ALIASES: dict[Any, NetworkPrecisionName] = {
    "bf16-true": "bf16-true",
    "64-true": "64-true",
    "64": "64-true",
    64: "64-true",
}


class NetworkPrecision(Precision):
    """Keeps the weights of the depth model and the pose network in bfloat16 or float64; batches stay float32.

    Lightning's own plugins also convert the batch and the default dtype, and thereby intrinsics, poses, ground truth,
    losses and metrics, which must be float32. Here, each layer with weights converts its own inputs and computes in the
    precision of its weights; operations without weights may stay in float32.

    With bfloat16 weights, updates of Adam that are smaller than 1 / 256 of a weight are lost by rounding; "bf16-mixed"
    keeps float32 weights and avoids that.

    Args:
        precision: "bf16-true" or "64-true".
    """

    def __init__(self, precision: NetworkPrecisionName) -> None:
        self.precision = precision
        self._hooks: dict[nn.Module, torch.utils.hooks.RemovableHandle] = {}

    def convert_module(self, module: nn.Module) -> nn.Module:
        """Convert the networks of a `DepthCompletion`, and make their layers convert their inputs."""
        for layer in _layers(module):
            layer.to(_DTYPES[self.precision])
            if layer not in self._hooks:
                self._hooks[layer] = layer.register_forward_pre_hook(_convert_inputs)
        return module

    def convert_input(self, data: Any) -> Any:
        """Leave the batch in float32."""
        return data

    def forward_context(self) -> AbstractContextManager[None]:
        """Leave PyTorch's default dtype as it is."""
        return nullcontext()

    def teardown(self) -> None:
        """Convert the networks back to float32."""
        for layer, hook in self._hooks.items():
            hook.remove()
            layer.float()
        self._hooks.clear()


def network_precision(name: Any) -> NetworkPrecision | None:
    """The plugin for a value of `trainer.precision`; None to use Lightning's own.

    Raises:
        DeuxError: training does not work in this precision.
    """
    if name == "16-true":
        raise DeuxError(
            "trainer.precision=16-true keeps the weights in float16, where Adam's squared gradients underflow: use "
            "bf16-mixed, or 16-mixed on a GPU without bfloat16."
        )
    known = isinstance(name, str | int) and name in _ALIASES
    return NetworkPrecision(_ALIASES[name]) if known else None


def _layers(module: nn.Module) -> Iterator[nn.Module]:
    """The leaf modules with weights in the networks of a `DepthCompletion`."""
    for name in ("model", "pose_source"):
        for layer in module.get_submodule(name).modules():
            if not any(layer.children()) and any(True for _ in layer.parameters()):
                yield layer


def _convert_inputs(layer: nn.Module, inputs: tuple[Any, ...]) -> tuple[Any, ...]:
    dtype = next(layer.parameters()).dtype
    return tuple(x.to(dtype) if isinstance(x, Tensor) and x.is_floating_point() else x for x in inputs)
