"""Reconstruction of the target frame from its source frames with predicted depth (Eq. 1 of the paper)."""

from typing import Literal

import torch
from kornia.geometry import depth_to_3d_v2, project_points, remap, transform_points
from torch import Tensor

from deux.geometry.tuned_forms import fuses_steps

NEAREST = 1e-3
"""Minimum depth of visible points in metres."""

FARTHEST = 1e4
"""Limit to which projected points are clamped, in half images."""

EDGE_TOLERANCE = 1e-3
"""Tolerance for points outside of the image, in pixels, for rounding errors of an identity warp."""


def reproject(
    source_images: Tensor,
    depth: Tensor,
    intrinsics: Tensor,
    source_from_target: Tensor,
    padding: Literal["zeros", "border"] = "border",
) -> tuple[Tensor, Tensor]:
    """Sample each source image where the points of the target frame project into it (Eq. 1).

    Every target pixel q is back-projected with its depth, transformed by the relative pose and projected; the source
    image is sampled bilinearly at K p K^-1 q d(q). Computed in float32 regardless of the precision of the inputs and
    of autocast, since bfloat16 has errors of whole pixels; float64 depth is not converted, for gradient checks.
    It does not make the host wait for the device.

    Args:
        source_images: N x S x 3 x H x W.
        depth: N x 1 x H x W metres, depth of the target frame; 0 = none.
        intrinsics: N x 3 x 3, upper triangular and not singular.
        source_from_target: N x S x 4 x 4, transforms from the target camera to each source camera.
        padding: value outside of the source image: the nearest border pixel (as in the published models) or zero.

    Returns:
        images: N x S x 3 x H x W, the target frame reconstructed from each source frame; differentiable with respect to
            depth and pose.
        visible: N x S x 1 x H x W bool, true where there is depth and the point lies in front of the source camera
            and inside its image.

    Example:
        >>> image, depth = torch.rand(1, 1, 3, 4, 4), torch.full((1, 1, 4, 4), 2.0)
        >>> camera = torch.tensor([[[2.0, 0.0, 1.5], [0.0, 2.0, 1.5], [0.0, 0.0, 1.0]]])
        >>> images, visible = reproject(image, depth, camera, torch.eye(4).expand(1, 1, 4, 4))  # nothing moves
        >>> torch.allclose(images, image, atol=1e-5), visible.all().item()
        (True, True)
    """
    dtype = torch.float64 if depth.dtype == torch.float64 else torch.float32
    with torch.autocast(depth.device.type, enabled=False):
        depth = depth.to(dtype)
        positions, distance = _project(depth, intrinsics.to(dtype), source_from_target.to(dtype))
        # Clamping only changes positions outside of the image. NaN must be replaced because the backward pass of
        # grid_sample on the CPU uses it as an address and crashes. Neither needs a gradient: it is zero so far outside.
        with torch.no_grad():
            positions.clamp_(-FARTHEST, FARTHEST).nan_to_num_(nan=FARTHEST)
        x, y = positions.flatten(0, 1).unbind(1)
        images = remap(
            source_images.to(dtype).flatten(0, 1),
            x,
            y,
            padding_mode=padding,
            align_corners=True,
            normalized_coordinates=True,
        )
    visible = _visible(positions.detach(), distance.detach(), depth.detach())
    return images.unflatten(0, source_images.shape[:2]), visible


def _project(depth: Tensor, intrinsics: Tensor, source_from_target: Tensor) -> tuple[Tensor, Tensor]:
    """Project the target's points into the source images; the arguments are those of `reproject`, of one dtype.

    kornia defines the values. Plain arithmetic computes the same values in a third of the time on a CPU, and on a GPU
    without multiplying millions of points by one matrix (docs/decisions/0012-kornia-geometry.md).

    Returns:
        positions: N x S x 2 x H x W, (x, y) with -1 and 1 at the centres of the outer pixels.
        distance: N x S x 1 x H x W metres along the source camera's axis, negative behind it.
    """
    project = _project_by_broadcasts if fuses_steps() else _project_by_kornia
    return project(depth, intrinsics, source_from_target)


def _project_by_kornia(depth: Tensor, intrinsics: Tensor, source_from_target: Tensor) -> tuple[Tensor, Tensor]:
    """Project the points with kornia."""
    sources, (height, width) = source_from_target.shape[1], depth.shape[-2:]
    points = depth_to_3d_v2(depth[:, 0], intrinsics).flatten(1, 2)[:, None].expand(-1, sources, -1, -1)
    motion = _without_skew(intrinsics, source_from_target)
    points = transform_points(motion.flatten(0, 1), points.flatten(0, 1)).view(len(depth), sources, height, width, 3)
    distance = points[..., 2:]
    # kornia mirrors points behind the camera and does not divide points in its plane.
    points = torch.cat([points[..., :2], distance.clamp(min=NEAREST)], dim=-1)
    x, y = project_points(points, intrinsics[:, None, None, None]).unbind(-1)
    # Plain numbers, since kornia's normalisation copies them to the device and waits for the copy.
    positions = torch.stack([x * (2.0 / max(width - 1, 1)) - 1.0, y * (2.0 / max(height - 1, 1)) - 1.0], dim=2)
    return positions, distance.movedim(-1, 2)


def _without_skew(intrinsics: Tensor, source_from_target: Tensor) -> Tensor:
    """Relative poses A p A^-1 for kornia's camera, which ignores the skew K[0, 1].

    A camera with skew is a camera without skew in sheared space: K = K' A, A = [[1, K[0, 1] / K[0, 0]], [0, 1]].
    """
    identity = torch.eye(4, dtype=intrinsics.dtype, device=intrinsics.device)
    slope = torch.zeros_like(identity).expand(len(intrinsics), 4, 4).clone()
    slope[:, 0, 1] = intrinsics[:, 0, 1] / intrinsics[:, 0, 0]
    return (identity + slope)[:, None] @ source_from_target @ (identity - slope)[:, None]


def _project_by_broadcasts(depth: Tensor, intrinsics: Tensor, source_from_target: Tensor) -> tuple[Tensor, Tensor]:
    """Project with the matrices multiplied first, so that only one point map is computed."""
    height, width = depth.shape[-2:]
    # Row by row instead of a matrix of numbers, which would have to be copied to the GPU.
    across, down, axis = intrinsics.unbind(1)
    across, down = across * (2.0 / max(width - 1, 1)) - axis, down * (2.0 / max(height - 1, 1)) - axis
    camera = torch.stack([across, down, axis], dim=1)[:, None]
    rotation, translation = source_from_target[..., :3, :3], source_from_target[..., :3, 3:]
    # X K = C R gives X = C R K^-1, exactly as accurate as a triangular solve.
    rays = torch.linalg.solve_triangular(intrinsics[:, None], camera @ rotation, upper=True, left=False)
    offset = (camera @ translation)[..., None]
    # Rays are linear in the pixel coordinates: columns and rows are multiplied separately and added by broadcasting.
    columns = rays[..., 0:1] * torch.arange(width, dtype=depth.dtype, device=depth.device)
    rows = rays[..., 1:2] * torch.arange(height, dtype=depth.dtype, device=depth.device) + rays[..., 2:3]
    points = torch.addcmul(offset, columns[..., None, :] + rows[..., None], depth[:, None])
    distance = points[:, :, 2:]
    return points[:, :, :2] / distance.clamp(min=NEAREST), distance


def _visible(positions: Tensor, distance: Tensor, depth: Tensor) -> Tensor:
    """Whether points have depth, lie in front of the source camera and inside its image: N x S x 1 x H x W."""
    height, width = depth.shape[-2:]
    x, y = positions[:, :, 0:1].abs(), positions[:, :, 1:2].abs()
    inside = (x <= 1.0 + 2.0 * EDGE_TOLERANCE / width) & (y <= 1.0 + 2.0 * EDGE_TOLERANCE / height)
    return inside & (distance > NEAREST) & (depth[:, None] > 0)
