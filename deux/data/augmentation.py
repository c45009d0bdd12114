"""Crops and training augmentation of one sample, before it becomes tensors."""

from dataclasses import dataclass, replace

import numpy as np

from deux.contracts import Augmentation


@dataclass(frozen=True)
class Sample:
    """Frame t with its S source frames, as read.

    Args:
        images: (1 + S) x H x W x 3 uint8, frame t first.
        sparse_depth: H x W float32 metres, 0 = none.
        input_sparse_depth: H x W float32, the points that the network is shown.
        intrinsics: 3 x 3.
        source_from_target: S x 4 x 4; None where the frames have no poses.
        ground_truth: H x W float32 metres, 0 = none; or None.
    """

    images: np.ndarray
    sparse_depth: np.ndarray
    input_sparse_depth: np.ndarray
    intrinsics: np.ndarray
    source_from_target: np.ndarray | None
    ground_truth: np.ndarray | None


def crop(sample: Sample, top: int, left: int, height: int, width: int) -> Sample:
    """Cut the same window out of everything; the principal point moves with it."""
    window = (slice(top, top + height), slice(left, left + width))
    intrinsics = sample.intrinsics.copy()
    intrinsics[:2, 2] -= left, top
    return replace(
        sample,
        images=sample.images[:, *window],
        sparse_depth=sample.sparse_depth[window],
        input_sparse_depth=sample.input_sparse_depth[window],
        intrinsics=intrinsics,
        ground_truth=None if sample.ground_truth is None else sample.ground_truth[window],
    )


def flip(sample: Sample) -> Sample:
    """Mirror a sample left to right, camera included: x becomes -x, so K and the motions are those of a mirrored world.

    With M = diag(-1, 1, 1, 1), a motion T becomes M T M, and the principal point cx becomes W - 1 - cx.
    """
    motions = sample.source_from_target
    mirror = np.array([-1.0, 1.0, 1.0, 1.0])
    intrinsics = sample.intrinsics.copy()
    intrinsics[0, 2] = sample.images.shape[2] - 1 - intrinsics[0, 2]
    intrinsics[0, 1] *= -1.0
    return replace(
        sample,
        images=sample.images[:, :, ::-1],
        sparse_depth=sample.sparse_depth[:, ::-1],
        input_sparse_depth=sample.input_sparse_depth[:, ::-1],
        intrinsics=intrinsics,
        source_from_target=None if motions is None else mirror[:, None] * motions * mirror,
        ground_truth=None if sample.ground_truth is None else sample.ground_truth[:, ::-1],
    )


def drop_points(sparse_depth: np.ndarray, fraction: float, rng: np.random.Generator) -> np.ndarray:
    """Remove a random `fraction` of the points of an H x W sparse depth map."""
    points = np.flatnonzero(sparse_depth)
    thinned = sparse_depth.copy()
    thinned.flat[rng.choice(points, round(fraction * len(points)), replace=False)] = 0.0
    return thinned


def augment(sample: Sample, augmentation: Augmentation, rng: np.random.Generator) -> Sample:
    """Draw a model's published augmentation. Only the network's input loses points, not what the loss reads."""
    if rng.random() < augmentation.flip:
        sample = flip(sample)
    if augmentation.drop_points is not None:
        fraction = rng.uniform(*augmentation.drop_points)
        sample = replace(sample, input_sparse_depth=drop_points(sample.input_sparse_depth, fraction, rng))
    return sample
