"""The arithmetic that a machine trains fastest in."""

import torch


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
