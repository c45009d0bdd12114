"""Active exploration for learning unsupervised depth perception."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from deux.deployment.array_prediction import predict_arrays as predict
    from deux.deployment.model_folders import from_pretrained, load
    from deux.deployment.published_checkpoints import load_published
    from deux.deployment.shipped_models import available

__all__ = ["__version__", "available", "from_pretrained", "load", "load_published", "predict"]
__version__ = "0.1.0"

LAZY = {
    "available": ("deux.deployment.shipped_models", "available"),
    "from_pretrained": ("deux.deployment.model_folders", "from_pretrained"),
    "load": ("deux.deployment.model_folders", "load"),
    "load_published": ("deux.deployment.published_checkpoints", "load_published"),
    "predict": ("deux.deployment.array_prediction", "predict_arrays"),
}
"""Modules of the package's functions. These import torch, which `--help` and composition must not wait for."""


def __getattr__(name: str) -> Any:
    """Import one of the `LAZY` functions at its first use (PEP 562)."""
    if name not in LAZY:
        raise AttributeError(f"module 'deux' has no attribute {name!r}")
    module, attribute = LAZY[name]
    return getattr(import_module(module), attribute)


def __dir__() -> list[str]:
    """The public names, for completion in notebooks."""
    return sorted(__all__)
