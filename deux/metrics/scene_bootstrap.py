"""Hierarchical bootstrap of a mean over seeds and the scenes of each seed (Davison and Hinkley 1997, section 3.8)."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from deux.metrics.intervals import Estimate

RESAMPLES = 4000


class SceneValue(NamedTuple):
    """A value of one test scene.

    Args:
        value: for example the difference of two errors, mm.
        weight: weight in the mean of its seed, the number of the scene's frames.
    """

    value: float
    weight: float


def least_scenes(seeds: Sequence[Mapping[str, SceneValue]]) -> int:
    """Minimum number of scenes per seed; with fewer, the interval of `scene_estimate` is far too narrow.

    Measured coverage with 3 seeds and a standard deviation between trainings of one eighth of that between scenes, for
    1, 2, 4 and 8 scenes: 77, 89, 96 and 97 % with different scenes for each seed, 10, 57, 82 and 90 % with the same.
    """
    return 8 if _crossed(seeds) else 4


def _crossed(seeds: Sequence[Mapping[str, SceneValue]]) -> bool:
    return all(seed.keys() == seeds[0].keys() for seed in seeds)


def scene_estimate(seeds: Sequence[Mapping[str, SceneValue]], random_seed: int = 0) -> Estimate:
    """Mean over seeds of the weighted means over scenes, with a 95 % bootstrap interval.

    Seeds are resampled with replacement, then the scenes of each seed. If all seeds have the same scenes, these are
    resampled once for all seeds, since seeds and scenes are then crossed and not nested. The half width is half the
    distance of the percentiles 2.5 and 97.5 of the resampled means. `scipy.stats.bootstrap` resamples one level only.

    The coverage is about right while the variance between scenes exceeds the variance between trainings. Otherwise the
    interval is too narrow for few seeds; use Student's t interval of the seeds' means
    (`deux.metrics.intervals.estimate`) instead. Measured coverage with 3 seeds of 16 scenes, for a standard deviation
    between trainings of 0, 1, 2 and 5 times the standard error over a seed's scenes: 97, 93, 84 and 76 %; Student's t:
    95 % in all cases. See docs/protocol.md.

    Args:
        seeds: for each seed, the values by scene name.
        random_seed: seed of the resampling.

    Returns:
        The mean, NaN without seeds or if a seed has no scenes; the half width, NaN with fewer than two seeds.
    """
    if not seeds or not all(seeds):
        return Estimate(np.nan)
    scenes = [sorted(one) for one in seeds]
    values, weights = zip(*(np.array([one[name] for name in sorted(one)], float).T for one in seeds), strict=True)
    mean = float(np.mean([np.average(v, weights=w) for v, w in zip(values, weights, strict=True)]))
    if len(seeds) < 2:
        return Estimate(mean)
    rng = np.random.default_rng(random_seed)
    crossed = _crossed(seeds)
    shared = rng.integers(len(scenes[0]), size=(RESAMPLES, len(scenes[0]))) if crossed else None
    means = np.zeros(RESAMPLES)
    for _ in seeds:
        drawn = rng.integers(len(seeds), size=RESAMPLES)
        for seed, (value, weight) in enumerate(zip(values, weights, strict=True)):
            rows = np.flatnonzero(drawn == seed)
            picked = rng.integers(len(value), size=(len(rows), len(value))) if shared is None else shared[rows]
            means[rows] += (value * weight)[picked].sum(axis=1) / weight[picked].sum(axis=1) / len(seeds)
    low, high = np.quantile(means, [0.025, 0.975])
    return Estimate(mean, float(high - low) / 2)
