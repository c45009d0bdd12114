"""Batches assembled on the device from cached frames, equal to those that `deux.data.triplets` makes on the CPU.

All images of a batch are cropped from the cache in one operation, and so are all depth maps of a kind. Indices,
intrinsics and poses are copied to the device together. Crops and augmentations are drawn on the CPU, with one seed for
each sample. An augmentation that consists only of flips, `RandomScale` and `DropPoints` is applied to the whole batch;
others are applied to one sample after the other. Only these may make the host wait for the device.
"""

import copy
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from deux.contracts import Augmentation, Batch
from deux.data.device_cache import FrameStack, Shipment, StoredFrame, colors, indexable, metres_on_device
from deux.data.drawn_windows import Window, draw, is_drawn
from deux.data.sample_parts import depth_span
from deux.data.transforms import augment_tensors
from deux.errors import DeuxError, image_size


class StoredSample(NamedTuple):
    """A sample before augmentation.

    Args:
        images: the cached images, the target's first.
        maps: the cached "sparse_depth" and, if it is read, "ground_truth".
        window: the crop; augmentations change it.
        seed: random seed of the augmentation.
    """

    images: Sequence[StoredFrame]
    maps: Mapping[str, StoredFrame]
    window: Window
    seed: int


class LoadedBatch(Batch):
    """A batch that the data loader can pin in page-locked memory, from which copies to a GPU are faster."""

    def pin_memory(self) -> "LoadedBatch":
        """Pin every tensor in place."""
        for name, value in vars(self).items():
            if isinstance(value, Tensor):
                setattr(self, name, value.pin_memory())
        self.prepared = {name: value.pin_memory() for name, value in self.prepared.items()}
        return self

    def to(self, device: torch.device) -> "LoadedBatch":
        """Copy the batch to a device; the host does not wait for a copy from pinned memory.

        Lightning calls this method. Without it Lightning would copy the object field by field, which takes as long as
        several operations on the GPU.
        """
        if self.image.device == device:
            return self

        def move(value: Tensor) -> Tensor:
            return value.to(device, non_blocking=device.type == "cuda")

        moved = copy.copy(self)
        for name, value in vars(self).items():
            if isinstance(value, Tensor):
                setattr(moved, name, move(value))
        moved.prepared = {name: move(value) for name, value in self.prepared.items()}
        return moved


def device_batch(samples: Sequence[StoredSample], augmentation: Sequence[Augmentation], device: torch.device) -> Batch:
    """Assemble one batch of float32 tensors on the device.

    Args:
        samples: the samples; their windows are changed in place.
        augmentation: the transforms, in order.
        device: the device of the cache.

    Raises:
        DeuxError: as `check_alike`, and as `augment_tensors`.
    """
    if not is_drawn(augmentation):
        return _augmented_batch(samples, augmentation, device)
    if augmentation:
        generator = torch.Generator()
        for sample in samples:
            draw(sample.window, augmentation, generator.manual_seed(sample.seed), sample.maps["sparse_depth"])
    check_alike(_kind(sample) for sample in samples)
    windows, count = [sample.window for sample in samples], len(samples)
    cameras = _cameras([one.intrinsics for one in windows], [one.motions for one in windows if one.motions is not None])
    if any(one.scale != 1.0 for one in windows):
        cameras["scale"] = np.array([one.scale for one in windows], np.float32)[:, None, None, None]
    parts = _cut(samples, device, cameras)
    if "scale" in parts:
        parts |= {name: parts[name] * parts["scale"] for name in samples[0].maps}
    if len(parts["hidden"]):
        parts["input_sparse_depth"] = parts["sparse_depth"].clone()
        parts["input_sparse_depth"].view(-1).index_fill_(0, parts["hidden"], 0.0)
    images, sources = colors(parts["images"], parts["white"]), len(samples[0].images) - 1
    targets, others = images.split([count, count * sources])
    return _batch(targets, others.view(count, sources, *targets.shape[1:]), parts)


def check_alike(samples: Iterable[tuple[tuple[int, ...], int, bool]]) -> None:
    """Raise DeuxError unless samples fit in one batch.

    Args:
        samples: size (height, width), number of source frames, and whether there are poses, of each sample.
    """
    sizes, counts, poses = (set(values) for values in zip(*samples, strict=True))
    if len(sizes) > 1:
        listed = ", ".join(map(image_size, sorted(sizes)))
        raise DeuxError(
            f"Frames of different sizes, {listed} pixels (width x height), do not fit in one batch: set a crop, "
            "training.crop=[height,width]."
        )
    if len(counts) > 1:
        raise DeuxError(f"Frames with {sorted(counts)} source frames do not fit in one batch.")
    if len(poses) > 1:
        raise DeuxError(
            "Some frames of one batch have poses and others have none: train on datasets that all have poses, or on "
            "datasets that all have none."
        )


def _augmented_batch(
    samples: Sequence[StoredSample], augmentation: Sequence[Augmentation], device: torch.device
) -> Batch:
    """A batch of samples that are augmented one by one, and of the same size only afterwards."""
    augmented = []
    alike = len({_kind(sample) for sample in samples}) == 1
    for together in [samples] if alike else [[sample] for sample in samples]:
        parts = _cut(together, device, {})
        targets, sources = parts["images"].tensor_split([len(together)])
        for number, sample in enumerate(together):
            its = slice(number * (len(sample.images) - 1), (number + 1) * (len(sample.images) - 1))
            tensors = {"images": torch.cat([targets[number : number + 1], sources[its]])}
            tensors |= {name: parts[name][number, 0] for name in sample.maps}
            tensors["intrinsics"] = torch.from_numpy(sample.window.intrinsics)
            if sample.window.motions is not None:
                tensors["source_from_target"] = torch.from_numpy(sample.window.motions.copy())
            depth = sample.window.shown_depth(sample.maps["sparse_depth"])
            augmented.append(augment_tensors(tensors, augmentation, sample.seed, len(depth), depth_span(depth)))
    check_alike(
        (tuple(sample["images"].shape[-2:]), len(sample["images"]) - 1, "source_from_target" in sample)
        for sample in augmented
    )
    cameras = _cameras(
        [sample["intrinsics"].numpy() for sample in augmented],
        [sample["source_from_target"].numpy() for sample in augmented if "source_from_target" in sample],
    )
    parts = _send(cameras, device)
    white = parts["white"]
    for name in ("sparse_depth", "input_sparse_depth", "ground_truth"):
        if name in augmented[0]:
            parts[name] = torch.stack([sample[name] for sample in augmented])[:, None]
    images = [sample["images"] for sample in augmented]
    if len({image.dtype for image in images}) > 1:
        images = [colors(image, white) for image in images]
    return _batch(
        colors(torch.stack([image[0] for image in images]), white),
        colors(torch.stack([image[1:] for image in images]), white),
        parts,
    )


def _cameras(intrinsics: Sequence[np.ndarray], motions: Sequence[np.ndarray]) -> dict[str, np.ndarray]:
    """Float32 inputs of a batch other than pixels: intrinsics, poses if there are any, and the constant 255."""
    arrays = {"intrinsics": np.stack(intrinsics), "white": np.array(255.0)}
    if motions:
        arrays["source_from_target"] = np.stack(motions)
    return {name: array.astype(np.float32) for name, array in arrays.items()}


def _send(arrays: Mapping[str, np.ndarray], device: torch.device) -> dict[str, Tensor]:
    shipment = Shipment()
    for array in arrays.values():
        shipment.add(array)
    return dict(zip(arrays, shipment.send(device), strict=True))


def _cut(samples: Sequence[StoredSample], device: torch.device, arrays: Mapping[str, np.ndarray]) -> dict[str, Tensor]:
    """Crop the images and depth maps of N samples that `check_alike` accepts.

    Args:
        samples: samples of one size h x w with S source frames each.
        device: the device of the cache.
        arrays: further arrays to copy to the device.

    Returns:
        "images", the N targets and then the N S sources, in the cache's type, each 3 x h x w; "sparse_depth" and
        "ground_truth", N x 1 x h x w metres; "hidden", indices of the hidden points among the N h w pixels; and the
        arrays.
    """
    windows, shipment = [sample.window for sample in samples], Shipment()
    rows, columns = np.stack([one.rows for one in windows]), np.stack([one.columns for one in windows])
    images = [sample.images[0] for sample in samples] + [image for sample in samples for image in sample.images[1:]]
    of_image = np.concatenate([np.arange(len(samples)), np.repeat(np.arange(len(samples)), len(samples[0].images) - 1)])
    cuts = {"images": _plan(images, rows[of_image], columns[of_image], shipment)}
    for name in samples[0].maps:
        cuts[name] = _plan([sample.maps[name] for sample in samples], rows, columns, shipment)
    area = rows.shape[1] * columns.shape[1]
    arrays = {"hidden": np.concatenate([n * area + one.hidden for n, one in enumerate(windows)]), **arrays}
    numbers = {name: shipment.add(array) for name, array in arrays.items()}
    sent = shipment.send(device)
    parts = {name: cut(sent) for name, cut in cuts.items()}
    for name in samples[0].maps:
        parts[name] = metres_on_device(parts[name])
    return parts | {name: sent[number] for name, number in numbers.items()}


def _plan(
    frames: Sequence[StoredFrame], rows: np.ndarray, columns: np.ndarray, shipment: Shipment
) -> Callable[[Sequence[Tensor]], Tensor]:
    """A function that crops M arrays on the device, given the tensors of the shipment: M x C x h x w.

    Args:
        frames: the M arrays; those in the same tensor are cropped together.
        rows: M x h.
        columns: M x w.
        shipment: the shipment to which the indices are added.
    """
    groups: dict[int, list[int]] = {}
    for number, frame in enumerate(frames):
        groups.setdefault(id(frame.stack), []).append(number)
    cuts = []
    for members in groups.values():
        stack = frames[members[0]].stack
        first = stack.channels * np.array([frames[number].row for number in members])
        indices = (
            (first[:, None] + np.arange(stack.channels))[:, :, None, None],
            rows[members][:, None, :, None],
            columns[members][:, None, None, :],
        )
        cuts.append(_Cut(stack, *(shipment.add(array) for array in indices)))
    if len(cuts) == 1:
        return cuts[0]
    order = shipment.add(np.argsort(np.concatenate(list(groups.values()))))

    def cut_all(sent: Sequence[Tensor]) -> Tensor:
        parts = [cut(sent) for cut in cuts]
        if len({part.dtype for part in parts}) > 1:  # depth maps that are stored as uint16 and as float32
            parts = [metres_on_device(part) for part in parts]
        kind = parts[0].dtype
        return torch.cat([part.view(indexable(kind)) for part in parts])[sent[order]].view(kind)

    return cut_all


@dataclass(frozen=True)
class _Cut:
    """A crop from one stack, with the positions of its indices in the shipment."""

    stack: FrameStack
    planes: int
    rows: int
    columns: int

    def __call__(self, sent: Sequence[Tensor]) -> Tensor:
        return self.stack.cut(sent[self.planes], sent[self.rows], sent[self.columns])


def _batch(image: Tensor, sources: Tensor, parts: Mapping[str, Tensor]) -> LoadedBatch:
    sparse_depth = parts["sparse_depth"]
    return LoadedBatch(
        image=image,
        sources=sources,
        sparse_depth=sparse_depth,
        validity=(sparse_depth > 0).to(torch.float32),
        input_sparse_depth=parts.get("input_sparse_depth", sparse_depth),
        intrinsics=parts["intrinsics"],
        source_from_target=parts.get("source_from_target"),
        ground_truth=parts.get("ground_truth"),
    )


def _kind(sample: StoredSample) -> tuple[tuple[int, ...], int, bool]:
    """Size, number of source frames, and whether there are poses; see `check_alike`."""
    window = sample.window
    return (len(window.rows), len(window.columns)), len(sample.images) - 1, window.motions is not None
