"""Fused Adam that supports channels-last parameters on a CPU without copies."""

from typing import Any

import torch
from torch import Tensor


class FusedAdam(torch.optim.Adam):
    """`torch.optim.Adam(fused=True)` without copies of channels-last gradients on a CPU.

    On a CPU, PyTorch 2.14 makes an unused copy of each gradient that is not contiguous; for 3 x 3 convolutions of 384
    channels, that takes longer than the step itself. Its kernel then traverses parameter, gradient and moments in
    memory order, and would misread a gradient whose layout differs from its parameter's. This class passes contiguous
    views of all tensors, with gradients in their parameters' layout. State and checkpoints are those of Adam.

    Args:
        parameters: the parameters to train.
        options: options of Adam, such as `lr` and `betas`.
    """

    def __init__(self, parameters: list[torch.nn.Parameter], **options: Any) -> None:
        super().__init__(parameters, fused=True, **options)

    def _init_group(
        self,
        group: dict[str, Any],
        parameters: list[Tensor],
        gradients: list[Tensor],
        means: list[Tensor],
        squares: list[Tensor],
        *others: list[Tensor],
    ) -> bool:
        """Collect a step's tensors, as Adam does, and replace them by views in memory order."""
        has_complex = super()._init_group(group, parameters, gradients, means, squares, *others)
        for i, parameter in enumerate(parameters):
            if _is_channels_last(parameter):
                gradient = gradients[i].contiguous(memory_format=torch.channels_last)
                for tensors, tensor in (
                    (parameters, parameter),
                    (gradients, gradient),
                    (means, means[i]),
                    (squares, squares[i]),
                ):
                    tensors[i] = tensor.permute(0, 2, 3, 1)
            else:
                gradients[i] = gradients[i].contiguous()
        return has_complex


def _is_channels_last(tensor: Tensor) -> bool:
    return not tensor.is_contiguous() and tensor.is_contiguous(memory_format=torch.channels_last)
