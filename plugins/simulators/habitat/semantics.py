"""What the numbers in Habitat-Sim's semantic images stand for."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

NOTHING = frozenset({"", "unknown", "unlabeled", "void"})
"""Categories of what nobody has annotated, in MP3D's and HM3D's words."""


@dataclass(frozen=True)
class Semantics:
    """The annotated objects of a scene.

    Args:
        label_names: the categories, sorted.
        object_labels: the category of each object.
        objects: object of each `semantic_id`, int32, -1 for none; the last entry stands for unknown numbers.
    """

    label_names: tuple[str, ...]
    object_labels: tuple[str, ...]
    objects: np.ndarray

    @cached_property
    def labels(self) -> np.ndarray:
        """Label of each object, int32, and -1 at the end for "no object"."""
        return np.array([*map(self.label_names.index, self.object_labels), -1], np.int32)

    def images(self, semantic: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Labels and objects in each pixel, H x W int32, of a semantic image, H x W int64."""
        last = len(self.objects) - 1
        objects = self.objects[np.where(semantic < last, semantic, last)]
        return self.labels[objects], objects


def read_semantics(objects: list[Any]) -> Semantics:
    """The annotation of a scene from Habitat-Sim's `semantic_scene.objects`.

    In MP3D and Gibson an object's `semantic_id` is its number in the description, in HM3D that of its line.
    """
    named = [(int(one.semantic_id), one.category.name()) for one in objects if one.category is not None]
    known = [(number, name) for number, name in named if number >= 0 and name.strip().lower() not in NOTHING]
    index = np.full(max((number for number, _ in known), default=-1) + 2, -1, np.int32)
    for position, (number, _) in enumerate(known):
        index[number] = position
    return Semantics(tuple(sorted({name for _, name in known})), tuple(name for _, name in known), index)
