"""Conversion of a pose network's six numbers to a rigid transform."""

import torch
from torch import Tensor


def skew_matrix(vector: Tensor) -> Tensor:
    """The N x 3 x 3 matrices of the cross products with N x 3 vectors."""
    x, y, z = vector.unbind(-1)
    zero = torch.zeros_like(x)
    return torch.stack([zero, -z, y, z, zero, -x, -y, x, zero], dim=-1).unflatten(-1, (3, 3))


def rotation_matrix(rotation: Tensor) -> Tensor:
    """Rotations by |v| radians about v: the exponential of so(3), by Rodrigues' formula.

    R = I + (sin a / a) [v]x + ((1 - cos a) / a^2) [v]x^2 with a = |v|, computed with sinc, so that R and its gradient
    are also defined at v = 0.

    Args:
        rotation: N x 3 rotation vectors.

    Returns:
        N x 3 x 3.
    """
    angle = torch.linalg.vector_norm(rotation, dim=-1)[:, None, None]
    cross = skew_matrix(rotation)
    identity = torch.eye(3, dtype=rotation.dtype, device=rotation.device)
    first = torch.sinc(angle / torch.pi)
    second = 0.5 * torch.sinc(angle / (2.0 * torch.pi)) ** 2
    return identity + first * cross + second * (cross @ cross)


def pose_matrix(pose: Tensor) -> Tensor:
    """Rigid transforms from pose vectors: rotate, then translate. Computed in float32, also under autocast.

    Args:
        pose: N x 6, a rotation vector (radians) and a translation (metres).

    Returns:
        N x 4 x 4 float32.
    """
    with torch.autocast(pose.device.type, enabled=False):
        pose = pose.float()
        upper = torch.cat([rotation_matrix(pose[:, :3]), pose[:, 3:, None]], dim=-1)
    # Created on the device: copying a list to the device would make the host wait.
    lower = torch.eye(4, dtype=pose.dtype, device=pose.device)[3:]
    return torch.cat([upper, lower.expand(len(pose), 1, 4)], dim=1)
