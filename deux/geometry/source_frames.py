"""Selection of the source frames of a target by parallax and overlap.

A useful source frame has a sufficient baseline and sees the same surfaces. Both follow from the poses and the sparse
points, without ground truth. The score is the view selection of MVSNet (Yao et al., ECCV 2018, section 4.1) with
visibility: for the target's sparse points p_i and the camera centres a of the target and b of the source,

    s(target, source) = 1/N sum_i v_i G(theta_i),    theta_i = angle at p_i between the rays to a and b,
    G(theta) = exp(-(theta - 5)^2 / (2 sigma^2)),    sigma = 1 degree up to 5 degrees and 10 degrees beyond.

v_i is 1 where p_i lies in front of the source camera, inside its image, and is not occluded, which is decided by the
source's own sparse point next to its projection; otherwise 0. The selected pair of candidates has the most qualified
sources (`SourceRule`) and, among such pairs, the largest

    (1 + e) (mean of both scores + 1/N sum_i of the larger v_i G(theta_i) of both),

where the second part prefers complementary sources, and e is 0.05 for one source before and one after the target, else
0.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from deux.geometry.poses import inverse

SOURCES = 2
"""Number of source frames of a target."""

_BEST_ANGLE, _BELOW, _ABOVE = 5.0, 1.0, 10.0
"""Degrees: theta_0, sigma_1 and sigma_2 of MVSNet."""

_BOTH_SIDES = 0.05
"""Bonus e of a pair with one source before and one after the target."""

_NEIGHBOURHOOD = 1 / 16
"""Radius in image widths in which a source's own sparse point can occlude a projected point."""

_NEARER = 0.7
"""A point is occluded if the source's own point is nearer than this fraction of its distance."""

_POINTS = 1000
"""Maximum number of sparse points of a frame that are used: every n-th, row by row."""


@dataclass(frozen=True)
class SourceRule:
    """Conditions for source frames with sufficient parallax.

    Args:
        reach: maximum distance from the target in frames.
        min_distance: minimum distance between the cameras, metres.
        max_distance: maximum distance between the cameras, metres.
        max_angle: maximum angle between the optical axes, degrees.
        min_overlap: minimum fraction of the target's points that are visible in the source.
    """

    reach: int = 5
    min_distance: float = 0.15
    max_distance: float = 0.8
    max_angle: float = 40.0
    min_overlap: float = 0.3

    def apart(self, target: np.ndarray, source: np.ndarray) -> bool:
        """Whether two poses, 4 x 4 camera-to-world, satisfy the limits for distance and angle."""
        distance = np.linalg.norm(source[:3, 3] - target[:3, 3])
        axes = float(np.clip(source[:3, 2] @ target[:3, 2], -1.0, 1.0))
        moved = self.min_distance <= distance <= self.max_distance
        return bool(moved and math.degrees(math.acos(axes)) <= self.max_angle)


@dataclass(frozen=True, eq=False)
class SourceView:
    """Pose, camera and sparse points of a frame.

    Args:
        pose: camera-to-world, 4 x 4.
        intrinsics: 3 x 3, for pixel centres at integers.
        size: height and width of the image in pixels.
        pixels: (x, y) of the sparse points, N x 2; frames without points can still be sources.
        depths: depths of the sparse points in metres, N.
    """

    pose: np.ndarray
    intrinsics: np.ndarray
    size: tuple[int, int]
    pixels: np.ndarray
    depths: np.ndarray

    @classmethod
    def of(cls, pose: np.ndarray, intrinsics: np.ndarray, sparse_depth: np.ndarray) -> "SourceView":
        """The view of a frame from sparse depth, H x W metres, 0 = none."""
        rows, columns = np.nonzero(sparse_depth)
        step = max(1, math.ceil(len(rows) / _POINTS))
        rows, columns = rows[::step], columns[::step]
        height, width = sparse_depth.shape
        depths = sparse_depth[rows, columns].astype(np.float64)
        return cls(pose, intrinsics, (height, width), np.stack([columns, rows], axis=1).astype(np.float64), depths)

    @cached_property
    def points(self) -> np.ndarray:
        """The sparse points in world coordinates, N x 3 metres."""
        rays = np.linalg.solve(self.intrinsics, np.c_[self.pixels, np.ones(len(self.pixels))].T)
        return (self.pose[:3, :3] @ (rays * self.depths)).T + self.pose[:3, 3]

    @cached_property
    def tree(self) -> cKDTree:
        """Search tree of the sparse points' pixels."""
        return cKDTree(self.pixels)


class ChosenSources(NamedTuple):
    """The source frames of a target.

    Args:
        steps: their signed distances from the target in frames; qualified sources first, then by descending score.
        parallax: whether at least one of them qualifies.
    """

    steps: tuple[int, ...]
    parallax: bool


def choose_sources(
    target: SourceView, candidates: Mapping[int, SourceView], rule: SourceRule | None = None
) -> ChosenSources:
    """Select the two best source frames among the candidates, whether they qualify or not.

    Args:
        target: the target frame.
        candidates: candidate frames by their signed distance from the target in frames.
        rule: conditions for qualified sources.

    Returns:
        Two of the candidates, or none with fewer than two candidates.
    """
    if len(candidates) < SOURCES:
        return ChosenSources((), False)
    steps = sorted(candidates, key=lambda step: (abs(step), step))
    values, qualified = _values([candidates[step] for step in steps], target, rule or SourceRule())
    scores = values.mean(axis=1)
    best, best_key = (0, 1), (-1, -1.0)
    for one, other in combinations(range(len(steps)), SOURCES):
        score = (scores[one] + scores[other]) / 2 + np.maximum(values[one], values[other]).mean()
        factor = 1 + _BOTH_SIDES if steps[one] * steps[other] < 0 else 1.0
        key = int(qualified[one]) + int(qualified[other]), float(factor * score)
        if key > best_key:
            best, best_key = (one, other), key
    one, other = sorted(best, key=lambda number: (not qualified[number], -scores[number]))
    return ChosenSources((steps[one], steps[other]), bool(best_key[0]))


def has_parallax(target: SourceView, sources: Sequence[SourceView], rule: SourceRule | None = None) -> bool:
    """Whether at least one of the source frames qualifies."""
    return bool(_values(sources, target, rule or SourceRule())[1].any())


def visible_points(target: SourceView, source: SourceView) -> np.ndarray:
    """Whether each of the target's sparse points is visible in the source, N bool.

    A point is occluded if the source's own sparse point nearest to its projection, within 1/16 of the image width, is
    nearer than 0.7 of its distance.
    """
    height, width = source.size
    local = inverse(source.pose) @ np.c_[target.points, np.ones(len(target.points))].T
    distance = local[2]
    seen = distance > 1e-3
    pixels = (source.intrinsics @ (local[:3] / np.where(seen, distance, 1.0)))[:2].T
    seen &= ((pixels >= -0.5) & (pixels <= (width - 0.5, height - 0.5))).all(axis=1)
    if len(source.pixels) and seen.any():
        _, nearest = source.tree.query(pixels[seen], distance_upper_bound=_NEIGHBOURHOOD * width)
        in_front = np.append(source.depths, np.inf)[nearest]  # the index is N if there is no neighbour
        seen[seen] = in_front >= _NEARER * distance[seen]
    return seen


def _values(sources: Sequence[SourceView], target: SourceView, rule: SourceRule) -> tuple[np.ndarray, np.ndarray]:
    """v_i G(theta_i) of each source, S x N (S x 1 zeros for a target without points), and whether it qualifies, S."""
    values = np.zeros((len(sources), max(1, len(target.pixels))))
    qualified = np.zeros(len(sources), dtype=bool)
    rays = target.points - target.pose[:3, 3]
    for number, source in enumerate(sources):
        baseline = source.pose[:3, 3] - target.pose[:3, 3]
        qualified[number] = rule.apart(target.pose, source.pose)
        if len(target.pixels):
            seen = visible_points(target, source)
            values[number] = seen * _usefulness(_angles(rays, rays - baseline))
            qualified[number] &= seen.mean() >= rule.min_overlap
        else:
            qualified[number] = False
    return values, qualified


def _angles(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Angles between vectors, N x 3, in degrees."""
    lengths = np.linalg.norm(first, axis=1) * np.linalg.norm(second, axis=1)
    cosines = np.einsum("ij,ij->i", first, second) / np.maximum(lengths, 1e-12)
    return np.degrees(np.arccos(np.clip(cosines, -1.0, 1.0)))


def _usefulness(angles: np.ndarray) -> np.ndarray:
    """The weight G, see the module docstring."""
    width = np.where(angles <= _BEST_ANGLE, _BELOW, _ABOVE)
    return np.exp(-((angles - _BEST_ANGLE) ** 2) / (2.0 * width**2))
