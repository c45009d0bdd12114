"""KBNet: unsupervised depth completion with calibrated backprojection layers (Wong and Soatto, ICCV 2021)."""

from deux_plugins.depth_models.kbnet.model import KBNet

__all__ = ["KBNet"]
