"""Semantic reconstruction reward: for labelled objects that are seen for the first time or better than before."""

from collections import defaultdict

import numpy as np

from deux.contracts import Episode, Experience, Need, Reward
from deux.errors import DeuxError
from deux.scenes.objects import NO_OBJECTS

Piece = tuple[int, int, int]
"""A label, and the column and row of a cell of the floor."""


class SemanticReconstructionReward(Reward):
    """The increase of the quality with which objects have been seen, summed over all pieces of objects.

    A piece consists of everything with the same label above the same cell of the floor, so that a long shelf counts
    more than a lamp. The quality of a view is the fraction of the image that the piece covers, divided by `full_view`
    and limited to 1; the quality of a piece is that of its best view so far. This is the paper's reward for states
    "that allow better semantic reconstruction", computed from true labels; the published agent, which has none,
    predicts clusters of image features instead.

    Args:
        cell: edge of a cell of the floor in metres.
        full_view: fraction of the image from which on a piece counts as fully seen.
        max_range: greatest distance of objects along the floor in metres; 3 in exploring_exploration.
    """

    needs = frozenset({Need.LABELS})

    def __init__(self, cell: float = 0.5, full_view: float = 0.01, max_range: float = 3.0) -> None:
        for name, value in (("cell", cell), ("full_view", full_view), ("max_range", max_range)):
            if not value > 0.0:
                raise DeuxError(f"semantic_reconstruction's {name} is {value}: it must be above 0.")
        self._cell = cell
        self._full_view = full_view
        self._max_range = max_range

    def reset(self, episode: Episode) -> None:
        """Begin an episode without seen objects.

        Raises:
            DeuxError: the scene has no labelled objects.
        """
        is_object = np.array([name not in NO_OBJECTS for name in episode.label_names], dtype=bool)
        if not is_object.any():
            raise DeuxError(
                "semantic_reconstruction needs labelled objects, but this scene has none: train in scenes with labels, "
                "such as scenes=apartments, or with another reward."
            )
        self._is_object = np.append(is_object, False)  # the last entry is for label -1, "unlabelled"
        self._rays = episode.camera.rays()
        self._quality: dict[Piece, float] = defaultdict(float)

    def __call__(self, experience: Experience) -> float:
        """The increase of quality, summed over all pieces that this frame shows."""
        seen = experience.observation
        assert seen.labels is not None
        assert seen.sensor_depth is not None
        chosen = self._is_object[seen.labels] & (seen.sensor_depth > 0.0)
        offset = (self._rays[chosen] * seen.sensor_depth[chosen][:, None]) @ seen.pose[:3, :3].T
        near = np.hypot(offset[:, 0], offset[:, 2]) <= self._max_range
        places = np.floor((offset[near][:, [0, 2]] + seen.pose[[0, 2], 3]) / self._cell).astype(np.int64)
        pieces, pixels = np.unique(np.column_stack([seen.labels[chosen][near], places]), axis=0, return_counts=True)
        increase = 0.0
        for (label, column, row), count in zip(pieces.tolist(), pixels.tolist(), strict=True):
            quality = min(1.0, count / (self._full_view * seen.labels.size))
            increase += max(0.0, quality - self._quality[label, column, row])
            self._quality[label, column, row] = max(quality, self._quality[label, column, row])
        return increase
