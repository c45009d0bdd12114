"""Batches made on a device from frames that lie there; equal to what `deux.data.triplets` makes on the CPU.

The draws of crops and augmentation are the CPU's, each sample with its own seed. Intrinsics and poses stay on the CPU
until the batch is stacked and go to the device in one copy. The host waits for the device nowhere, unless a transform
of the augmentation does.
"""

from collections.abc import Iterable, Mapping, Sequence

import numpy as np
import torch
from torch import Tensor

from deux.contracts import Augmentation, Batch
from deux.data.device_cache import colors, metres_on_device, upload
from deux.data.transforms import augment_tensors
from deux.errors import DeuxError


def device_sample(
    images: Sequence[Tensor],
    maps: Mapping[str, Tensor],
    intrinsics: np.ndarray,
    motions: np.ndarray | None,
    points: int | None,
    augmentation: Sequence[Augmentation],
    seed: int,
) -> dict[str, Tensor]:
    """A training sample as `deux.data.transforms` describes it, intrinsics and poses on the CPU.

    Args:
        images: 3 x H x W uint8 each, the target first.
        maps: H x W each, as the cache holds them.
        intrinsics: 3 x 3 float64.
        motions: S x 4 x 4 float64, or None.
        points: number of points of the sparse depth, if it is known.
        augmentation: is applied if there is any.
        seed: of the augmentation.
    """
    sample = {"images": torch.stack(list(images))}
    sample |= {name: metres_on_device(depth) for name, depth in maps.items()}
    sample["intrinsics"] = torch.from_numpy(intrinsics)
    if motions is not None:
        sample["source_from_target"] = torch.from_numpy(motions.copy())
    return augment_tensors(sample, augmentation, seed, points) if augmentation else sample


def stack_samples(samples: Sequence[Mapping[str, Tensor]], device: torch.device) -> Batch:
    """Samples of `device_sample` as one batch of float32 tensors on the device.

    Raises:
        DeuxError: as `check_alike`.
    """
    check_alike(
        (tuple(sample["images"].shape[-2:]), len(sample["images"]) - 1, "source_from_target" in sample)
        for sample in samples
    )

    def maps(name: str) -> Tensor:
        return torch.stack([sample[name] for sample in samples])[:, None]

    sparse_depth = maps("sparse_depth")
    intrinsics, motions = _cameras(samples, device)
    return Batch(
        image=colors([sample["images"][0] for sample in samples]),
        sources=colors([sample["images"][1:] for sample in samples]),
        sparse_depth=sparse_depth,
        validity=(sparse_depth > 0).to(torch.float32),
        input_sparse_depth=maps("input_sparse_depth") if "input_sparse_depth" in samples[0] else sparse_depth,
        intrinsics=intrinsics,
        source_from_target=motions,
        ground_truth=maps("ground_truth") if "ground_truth" in samples[0] else None,
    )


def check_alike(samples: Iterable[tuple[tuple[int, ...], int, bool]]) -> None:
    """Raise DeuxError unless samples fit in one batch.

    Args:
        samples: of each, its size (height, width), the number of its source frames, and whether it has poses.
    """
    sizes, counts, poses = (set(values) for values in zip(*samples, strict=True))
    if len(sizes) > 1:
        raise DeuxError(f"Frames of the sizes {sorted(sizes)} (height, width) do not fit in one batch: give a crop.")
    if len(counts) > 1:
        raise DeuxError(f"Frames with {sorted(counts)} source frames do not fit in one batch.")
    if len(poses) > 1:
        raise DeuxError(
            "Some frames of one batch have poses and others have none: train on datasets that all have poses, or on "
            "those without."
        )


def _cameras(samples: Sequence[Mapping[str, Tensor]], device: torch.device) -> tuple[Tensor, Tensor | None]:
    """Intrinsics N x 3 x 3 and, if there are any, poses N x S x 4 x 4, sent to the device together."""
    intrinsics = torch.stack([sample["intrinsics"] for sample in samples]).to(torch.float32)
    if "source_from_target" not in samples[0]:
        return upload(intrinsics, device), None
    motions = torch.stack([sample["source_from_target"] for sample in samples]).to(torch.float32)
    sent = upload(torch.cat([intrinsics.flatten(), motions.flatten()]), device)
    cameras, poses = sent.split([intrinsics.numel(), motions.numel()])
    return cameras.view(intrinsics.shape), poses.view(motions.shape)
