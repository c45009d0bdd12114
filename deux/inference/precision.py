"""The arithmetic and the device that a machine is fastest with."""

import copy
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import torch
from torch import Tensor

from deux.inference.prediction import CompletionNetwork, eval_mode
from deux.inference.threads import each_frame_apart

AUTOCAST = {"bf16-mixed": torch.bfloat16, "16-mixed": torch.float16}
"""The number format in which the network computes, by Lightning's name of the precision; float32 in all others."""


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

    On a CPU each frame of a batch is predicted by itself on one thread, so that its bits depend on nothing else. It can
    be pickled: the weights travel, and go to the device of the process in which they arrive.

    Args:
        model: moved to the device.
        accelerator: Lightning's accelerator setting.
        precision: Lightning's name of the precision; None for the fastest.
    """

    device: torch.device
    """Where the model is and its predictions stay."""

    def __init__(self, model: CompletionNetwork, accelerator: str = "auto", precision: str | None = None) -> None:
        self.precision = precision or default_precision(accelerator)
        self.device = default_device(accelerator)
        self._accelerator = accelerator
        self._model: CompletionNetwork = model.to(self.device)
        self._threads = torch.get_num_threads()

    @property
    def batch_invariant(self) -> bool:
        """Whether a frame's prediction is the same, bit by bit, in any batch: on a CPU it is, on a card it may not."""
        return self.device.type == "cpu"

    def __call__(self, image: Tensor, sparse_depth: Tensor, intrinsics: Tensor) -> Tensor:
        """As `DepthModel.predict`."""
        if not self.batch_invariant:
            return self._predict(image, sparse_depth, intrinsics)
        with eval_mode(self._model):  # the threads must not switch it to and fro
            return each_frame_apart(self._predict, (image, sparse_depth, intrinsics), self._threads)

    def _predict(self, image: Tensor, sparse_depth: Tensor, intrinsics: Tensor) -> Tensor:
        dtype = AUTOCAST.get(self.precision)
        with torch.autocast(self.device.type, dtype, enabled=dtype is not None):
            return self._model.predict(image, sparse_depth, intrinsics)

    def __reduce__(self) -> tuple[Any, ...]:
        on_cpu = self._model if self.device.type == "cpu" else copy.deepcopy(self._model).to(torch.device("cpu"))
        return type(self), (on_cpu, self._accelerator, self.precision)
