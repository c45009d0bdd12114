"""Application of torchvision's transforms v2 to training samples, and the transform `DropPoints`.

A sample is a dictionary of the parts in `deux.data.sample_parts`. Photometric transforms change all its images in the
same way; geometric transforms change images, depth maps, intrinsics and poses consistently. Random transforms draw from
torch's default generator, which is seeded for each sample.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import torch
from torch import Tensor
from torchvision.transforms import v2

from deux.contracts import Augmentation
from deux.data.device_cache import to_device
from deux.data.sample_parts import PART_TYPES, InputSparseDepth, Intrinsics, with_points
from deux.errors import DeuxError, check_range


def augment(sample: Mapping[str, np.ndarray], augmentation: Sequence[Augmentation], seed: int) -> dict[str, np.ndarray]:
    """Apply an augmentation to the arrays of a sample; see `augment_tensors`."""
    tensors = {name: torch.from_numpy(array) for name, array in sample.items()}
    return {name: tensor.numpy() for name, tensor in augment_tensors(tensors, augmentation, seed).items()}


def augment_tensors(
    sample: Mapping[str, Tensor],
    augmentation: Sequence[Augmentation],
    seed: int,
    points: int | None = None,
    span: tuple[float, float] | None = None,
) -> dict[str, Tensor]:
    """Apply an augmentation to a sample.

    Args:
        sample: the tensors of a sample by name, without "input_sparse_depth"; the transforms may modify them.
            Intrinsics and poses are on the CPU, the others on one device.
        augmentation: the transforms, in order.
        seed: seed of torch's default generator on the CPU, from which the transforms draw.
        points: number of points in the sparse depth, see `InputSparseDepth`.
        span: depth in metres of the nearest and the farthest point.

    Returns:
        The tensors of the sample, including "input_sparse_depth".

    Raises:
        DeuxError: a transform is not possible for a camera, or has changed the size of only some parts.
    """
    tensors: dict[str, Tensor] = {name: tensor.as_subclass(PART_TYPES[name]) for name, tensor in sample.items()}
    tensors["input_sparse_depth"] = with_points(sample["sparse_depth"].clone(), points, span)
    height, width = sample["images"].shape[-2:]
    tensors["intrinsics"] = Intrinsics(tensors["intrinsics"], (height, width))
    state = torch.get_rng_state()
    torch.default_generator.manual_seed(seed)  # not torch.manual_seed, which would set the GPUs' generators as well
    try:
        for transform in augmentation:
            tensors = transform(tensors)
    finally:
        torch.set_rng_state(state)
    augmented = {name: tensor.as_subclass(Tensor) for name, tensor in tensors.items()}
    _check_sizes(augmented, getattr(tensors["intrinsics"], "canvas_size", None))
    return augmented


class DropPoints(v2.Transform):
    """Remove a random part of the sparse points from the network's input, but not from the losses.

    Args:
        fraction: least and greatest fraction of points to remove, drawn uniformly for each sample.
        p: probability that the transform is applied.

    Raises:
        DeuxError: a fraction or the probability is not in [0, 1].
    """

    def __init__(self, fraction: tuple[float, float], p: float = 0.5) -> None:
        super().__init__()
        for name, value in (("fraction", fraction[0]), ("fraction", fraction[1]), ("p", p)):
            check_range(f"DropPoints: {name}", value, 0.0, 1.0)
        self.fraction, self.p = fraction, p

    def draw_fraction(self, generator: torch.Generator | None = None) -> float:
        """Draw the fraction of points to remove; by default from torch's default generator."""
        drop, position = torch.rand(2, generator=generator).tolist()
        least, most = self.fraction
        return float(least + (most - least) * position) if drop < self.p else 0.0

    @staticmethod
    def draw_points(count: int, fraction: float, generator: torch.Generator | None = None) -> Tensor:
        """Draw which of `count` points to remove: unsorted indices of the points in row-major order."""
        return torch.randperm(count, generator=generator)[: round(fraction * count)]

    def make_params(self, flat_inputs: list[Any]) -> dict[str, float]:
        """Draw the fraction of points to remove."""
        return {"fraction": self.draw_fraction()}

    def transform(self, inpt: Any, params: dict[str, float]) -> Any:
        """Remove points from an `InputSparseDepth`; other parts are returned as they are."""
        if not isinstance(inpt, InputSparseDepth) or params["fraction"] == 0.0:
            return inpt
        depth = inpt.as_subclass(Tensor)
        count = int(torch.count_nonzero(depth)) if inpt.points is None else inpt.points
        hidden = self.draw_points(count, params["fraction"])
        if len(hidden) == 0:
            return inpt
        remove = _remove_points if depth.device.type == "cpu" else remove_points_on_device
        return with_points(remove(depth, hidden), count - len(hidden))


def _remove_points(depth: Tensor, hidden: Tensor) -> Tensor:
    """Set some points of a depth map to 0, given their indices among the points in row-major order."""
    remaining = depth.numpy().copy()
    remaining.flat[np.flatnonzero(remaining)[hidden.numpy()]] = 0.0
    return torch.from_numpy(remaining)


def remove_points_on_device(depth: Tensor, hidden: Tensor) -> Tensor:
    """Set some points of a depth map to 0; the host does not wait for the device.

    Args:
        depth: H x W on a device, 0 = none.
        hidden: indices of the points to remove among the points in row-major order, on the CPU; at least one.
    """
    is_point = depth.flatten() != 0
    number = is_point.cumsum(0)  # index of each point + 1; 0 at pixels before the first point
    removed = torch.zeros(depth.numel() + 1, dtype=torch.bool, device=depth.device)
    removed.index_fill_(0, to_device(hidden + 1, depth.device), True)
    return depth.masked_fill((is_point & removed[number]).view_as(depth), 0.0)


def _check_sizes(sample: Mapping[str, Tensor], canvas_size: tuple[int, int] | None) -> None:
    """Raise DeuxError if the size of images or depth maps differs from that of the intrinsics."""
    for name, tensor in sample.items():
        size = tuple(tensor.shape[-2:])
        if name not in ("intrinsics", "source_from_target") and size != canvas_size:
            raise DeuxError(
                f"The augmentation left {name} of {size} pixels with intrinsics of {canvas_size} pixels "
                "(height, width): its transforms must change all parts of a sample consistently, as those of "
                "torchvision.transforms.v2 do."
            )
