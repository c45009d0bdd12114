"""Adam in one pass over each parameter, whatever its layout in memory."""

from typing import Any

import torch
from torch import Tensor


class FusedAdam(torch.optim.Adam):
    """`torch.optim.Adam(fused=True)` without copies of channels-last gradients on a CPU.

    There, PyTorch 2.14 copies each gradient that is not contiguous and does not use the copy: at 3 x 3 convolutions of
    384 channels that takes longer than the step itself. It then works through parameter, gradient and moments in the
    order of their memory, so that a gradient laid out unlike its parameter would be misread. Here it is given all of
    them as contiguous views, and such a gradient in its parameter's layout. State and checkpoints are Adam's own.

    Args:
        parameters: the parameters to train.
        options: Adam's, such as `lr` and `betas`.
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
        """Collect what a step works on, as Adam does, and view it in the order of memory."""
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
