"""Applies torchvision's transforms v2 to training samples: images, depth maps, camera and poses change together.

A sample is a dictionary of the parts of `deux.data.sample_parts`. Any transform of `torchvision.transforms.v2` applies
to it: photometric ones change the images, all frames alike; those that change the geometry change all parts. Random
ones draw from torch's default generator, which is seeded for each sample.
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
    """Apply a model's augmentation to the arrays of a sample, as `augment_tensors` does to tensors."""
    tensors = {name: torch.from_numpy(array) for name, array in sample.items()}
    return {name: tensor.numpy() for name, tensor in augment_tensors(tensors, augmentation, seed).items()}


def augment_tensors(
    sample: Mapping[str, Tensor],
    augmentation: Sequence[Augmentation],
    seed: int,
    points: int | None = None,
    span: tuple[float, float] | None = None,
) -> dict[str, Tensor]:
    """Apply a model's augmentation to a sample.

    Args:
        sample: the tensors of a sample by name, without "input_sparse_depth"; the transforms may change them.
            Intrinsics and poses are on the CPU, the others on one device.
        augmentation: the transforms, in order.
        seed: of all that the transforms draw from torch's default generator on the CPU.
        points: number of points in the sparse depth, see `InputSparseDepth`.
        span: depth in metres of the nearest and the farthest of them.

    Returns:
        The tensors of the sample, "input_sparse_depth" among them.

    Raises:
        DeuxError: a transform makes no sense for a camera, or has changed the size of one part without the others.
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
    """Hide a random part of the sparse points from the network; the losses keep all of them.

    Args:
        fraction: least and most of the points that are hidden, drawn evenly for each sample.
        p: probability that any are hidden.

    Raises:
        DeuxError: a fraction or the probability is not in [0, 1].
    """

    def __init__(self, fraction: tuple[float, float], p: float = 0.5) -> None:
        super().__init__()
        for name, value in (("fraction", fraction[0]), ("fraction", fraction[1]), ("p", p)):
            check_range(f"DropPoints: {name}", value, 0.0, 1.0)
        self.fraction, self.p = fraction, p

    def draw_fraction(self, generator: torch.Generator | None = None) -> float:
        """The fraction that a sample loses; by default drawn from torch's default generator."""
        drop, position = torch.rand(2, generator=generator).tolist()
        least, most = self.fraction
        return float(least + (most - least) * position) if drop < self.p else 0.0

    @staticmethod
    def draw_points(count: int, fraction: float, generator: torch.Generator | None = None) -> Tensor:
        """Which of so many points are hidden, numbered row by row from 0; not sorted."""
        return torch.randperm(count, generator=generator)[: round(fraction * count)]

    def make_params(self, flat_inputs: list[Any]) -> dict[str, float]:
        """Draw the fraction that this sample loses."""
        return {"fraction": self.draw_fraction()}

    def transform(self, inpt: Any, params: dict[str, float]) -> Any:
        """Remove the points from an `InputSparseDepth`; everything else is left as it is."""
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
    """The depth map without some of its points, which are numbered row by row."""
    kept = depth.numpy().copy()
    kept.flat[np.flatnonzero(kept)[hidden.numpy()]] = 0.0
    return torch.from_numpy(kept)


def remove_points_on_device(depth: Tensor, hidden: Tensor) -> Tensor:
    """The depth map without some of its points; the host does not wait for the device.

    Args:
        depth: H x W on a device, 0 = none.
        hidden: the points to remove, on the CPU, numbered row by row from 0; at least one of them.
    """
    is_point = depth.flatten() != 0
    number = is_point.cumsum(0)  # of each point, from 1; pixels before the first point have 0
    removed = torch.zeros(depth.numel() + 1, dtype=torch.bool, device=depth.device)
    removed.index_fill_(0, to_device(hidden + 1, depth.device), True)
    return depth.masked_fill((is_point & removed[number]).view_as(depth), 0.0)


def _check_sizes(sample: Mapping[str, Tensor], canvas_size: tuple[int, int] | None) -> None:
    """Raise DeuxError if images and depth maps are not of the intrinsics' size."""
    for name, tensor in sample.items():
        size = tuple(tensor.shape[-2:])
        if name not in ("intrinsics", "source_from_target") and size != canvas_size:
            raise DeuxError(
                f"The augmentation left {name} of {size} pixels with intrinsics of {canvas_size} pixels "
                "(height, width): its transforms must treat all parts of a sample alike, as those of "
                "torchvision.transforms.v2 do."
            )
