"""The arithmetic and the device that a machine is fastest with."""

from collections.abc import Iterator
from contextlib import contextmanager

import torch
from torch import Tensor

from deux.inference.prediction import CompletionNetwork


def default_precision(accelerator: str = "auto") -> str:
    """Lightning's name of the precision to train in.

    It is "bf16-mixed" where the hardware multiplies bfloat16 itself, else "32-true". Geometry, losses and metrics
    are float32 in either case.

    Args:
        accelerator: Lightning's accelerator setting; "auto" takes a CUDA device where there is one.
    """
    if accelerator in ("auto", "gpu", "cuda") and torch.cuda.is_available():
        native = torch.cuda.is_bf16_supported(including_emulation=False)
    elif accelerator in ("auto", "cpu"):
        # Emulated bfloat16 is slower than float32, so only the instructions themselves count.
        native = torch.cpu._is_amx_tile_supported() or torch.cpu._is_avx512_bf16_supported()
    else:
        native = False
    return "bf16-mixed" if native else "32-true"


def default_device(accelerator: str = "auto") -> torch.device:
    """The device that Lightning would train on: a CUDA device where there is one and the setting allows it."""
    cuda = accelerator in ("auto", "gpu", "cuda") and torch.cuda.is_available()
    return torch.device("cuda" if cuda else "cpu")


@contextmanager
def tf32_convolutions(allowed: bool) -> Iterator[None]:
    """Say for a while whether CUDA may round the inputs of float32 convolutions to TensorFloat-32, 10 bits of mantissa.

    PyTorch allows it for convolutions, unasked, and not for matrix products; those are never changed here, since the
    geometry is made of them. TensorFloat-32 is to the structural similarity, a difference of large means, what
    bfloat16 is to colours.
    """
    before = torch.backends.cudnn.allow_tf32
    torch.backends.cudnn.allow_tf32 = allowed
    try:
        yield
    finally:
        torch.backends.cudnn.allow_tf32 = before


class FastPredictor:
    """`DepthModel.predict` on the fastest device and in the fastest precision, for a robot that waits for its depth.

    Args:
        model: moved to the device.
        accelerator: Lightning's accelerator setting.
    """

    device: torch.device
    """Where the model is and its predictions stay."""

    def __init__(self, model: CompletionNetwork, accelerator: str = "auto") -> None:
        self.precision = default_precision(accelerator)
        self.device = default_device(accelerator)
        self._model: CompletionNetwork = model.to(self.device)

    def __call__(self, image: Tensor, sparse_depth: Tensor, intrinsics: Tensor) -> Tensor:
        """As `DepthModel.predict`."""
        with torch.autocast(self.device.type, torch.bfloat16, enabled=self.precision == "bf16-mixed"):
            return self._model.predict(image, sparse_depth, intrinsics)
