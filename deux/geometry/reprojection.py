"""Rebuilding the target frame from its source frames with the predicted depth (Eq. 1 of the paper)."""

from typing import Literal

import torch
import torch.nn.functional as F
from torch import Tensor

NEAREST = 1e-3
"""Points closer to a camera's plane than this (metres), or behind it, are not seen by it."""

FARTHEST = 1e4
"""How far outside the image, in half images, a projected point is let go."""

EDGE_TOLERANCE = 1e-3
"""Pixels by which a point may miss the image and still count as inside: rounding of an identity warp."""


def reproject(
    source_images: Tensor,
    depth: Tensor,
    intrinsics: Tensor,
    source_from_target: Tensor,
    padding: Literal["zeros", "border"] = "border",
) -> tuple[Tensor, Tensor]:
    """Sample each source image where the points of the target frame project into it (Eq. 1).

    Every target pixel q is back-projected with its depth, moved by the relative pose and projected: the source
    image is read bilinearly at K p K^-1 q d(q). Computed in float32 whatever the precision of the inputs and of an
    enclosing autocast (bfloat16 misplaces pixels by whole units); float64 depth is kept, for gradient checks.

    Args:
        source_images: N x S x 3 x H x W.
        depth: N x 1 x H x W metres, the target frame's; 0 = none.
        intrinsics: N x 3 x 3, upper triangular and not singular.
        source_from_target: N x S x 4 x 4, carries points of the target camera into each source camera.
        padding: what is read outside the source image: the nearest border pixel (the published models' way) or zero.

    Returns:
        images: N x S x 3 x H x W, the target frame as each source frame shows it; differentiable in depth and pose.
        visible: N x S x 1 x H x W bool, true where there is depth and the point lies in front of the source camera
            and inside its image.
    """
    dtype = torch.float64 if depth.dtype == torch.float64 else torch.float32
    with torch.autocast(depth.device.type, enabled=False):
        depth = depth.to(dtype)
        points = _project(depth, intrinsics.to(dtype), source_from_target.to(dtype))
        distance = points[:, :, 2:]
        # The clamps keep division and positions finite; what they change is invisible. A NaN must go because
        # grid_sample's backward pass on the CPU takes it for an address and brings the process down.
        grid = (points[:, :, :2] / distance.clamp(min=NEAREST)).clamp(-FARTHEST, FARTHEST).nan_to_num(nan=FARTHEST)
        images = F.grid_sample(
            source_images.to(dtype).flatten(0, 1),
            grid.flatten(0, 1).permute(0, 2, 3, 1),
            mode="bilinear",
            padding_mode=padding,
            align_corners=True,
        )
    visible = _visible(grid.detach(), distance.detach(), depth.detach())
    return images.unflatten(0, source_images.shape[:2]), visible


def _project(depth: Tensor, intrinsics: Tensor, source_from_target: Tensor) -> Tensor:
    """Homogeneous image points N x S x 3 x H x W in grid_sample's coordinates: -1 and 1 are the outer pixel centres."""
    height, width = depth.shape[-2:]
    normalise = intrinsics.new_tensor(
        [[2.0 / max(width - 1, 1), 0.0, -1.0], [0.0, 2.0 / max(height - 1, 1), -1.0], [0.0, 0.0, 1.0]]
    )
    camera = (normalise @ intrinsics)[:, None]
    rotation, translation = source_from_target[..., :3, :3], source_from_target[..., :3, 3:]
    # X K = C R gives X = C R K^-1, exactly as accurate as a triangular solve and without a device synchronisation.
    rays = torch.linalg.solve_triangular(intrinsics[:, None], camera @ rotation, upper=True, left=False)
    offset = (camera @ translation)[..., None]
    # A ray is linear in its pixel, so columns and rows are multiplied apart and meet in one broadcast sum.
    columns = rays[..., 0:1] * torch.arange(width, dtype=depth.dtype, device=depth.device)
    rows = rays[..., 1:2] * torch.arange(height, dtype=depth.dtype, device=depth.device) + rays[..., 2:3]
    return torch.addcmul(offset, columns[..., None, :] + rows[..., None], depth[:, None])


def _visible(grid: Tensor, distance: Tensor, depth: Tensor) -> Tensor:
    """Which points have depth, lie in front of the source camera and fall inside its image: N x S x 1 x H x W."""
    height, width = depth.shape[-2:]
    x, y = grid[:, :, 0:1].abs(), grid[:, :, 1:2].abs()
    inside = (x <= 1.0 + 2.0 * EDGE_TOLERANCE / width) & (y <= 1.0 + 2.0 * EDGE_TOLERANCE / height)
    return inside & (distance > NEAREST) & (depth[:, None] > 0)
