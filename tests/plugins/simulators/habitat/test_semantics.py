from dataclasses import dataclass

import numpy as np

from deux_plugins.simulators.habitat.semantics import read_semantics


@dataclass
class Category:
    text: str

    def name(self) -> str:
        return self.text


@dataclass
class Object:
    semantic_id: int
    category: Category | None


def test_numbers_become_objects_and_categories() -> None:
    semantics = read_semantics(
        [
            Object(0, Category("Unknown")),
            Object(7, Category("wall")),
            Object(3, Category("chair")),
            Object(4, Category("chair")),
            Object(5, None),
            Object(6, Category("void")),
        ]
    )
    assert semantics.label_names == ("chair", "wall")
    assert semantics.object_labels == ("wall", "chair", "chair")
    labels, objects = semantics.images(np.array([[0, 3, 4, 5], [6, 7, 8, 2**32 - 1]], np.int64))
    np.testing.assert_array_equal(objects, [[-1, 1, 2, -1], [-1, 0, -1, -1]])
    np.testing.assert_array_equal(labels, [[-1, 0, 0, -1], [-1, 1, -1, -1]])
    assert labels.dtype == objects.dtype == np.int32


def test_a_scene_without_annotation_has_no_names() -> None:
    semantics = read_semantics([])
    assert semantics.label_names == semantics.object_labels == ()
    labels, objects = semantics.images(np.array([[0, 9]], np.int64))
    assert (labels == -1).all()
    assert (objects == -1).all()
