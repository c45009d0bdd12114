from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from deux.scenes.objects import find_objects
from deux_plugins.scenes.apartments import apartment
from deux_plugins.scenes.parts.mesh_builder import MeshBuilder

NAMES = ("floor", "chair", "table")


def chair(x: float) -> list[tuple[tuple[float, ...], tuple[float, ...]]]:
    """Four legs and a seat that rests on them without sharing a vertex."""
    legs = [((x + a, 0.0, b), (x + a + 0.04, 0.45, b + 0.04)) for a in (0.0, 0.36) for b in (0.0, 0.36)]
    return [*legs, ((x, 0.45, 0.0), (x + 0.4, 0.5, 0.4))]


@pytest.fixture
def furnished(mesh_of, slab):
    """furnished((label, boxes), ...): a mesh of labelled boxes, and for each of its faces the number of its pair."""

    def make(*furniture):
        parts = [(label, number, slab(*box)) for number, (label, boxes) in enumerate(furniture) for box in boxes]
        mesh = mesh_of(*(part for _, _, part in parts))
        labels = np.concatenate([np.full(len(part.faces), NAMES.index(label), np.int32) for label, _, part in parts])
        numbers = np.concatenate([np.full(len(part.faces), number) for _, number, part in parts])
        return replace(mesh, face_label=labels, label_names=NAMES), numbers

    return make


def groups(face_object: np.ndarray, numbers: np.ndarray) -> set[tuple[int, int]]:
    return set(zip(face_object.tolist(), numbers.tolist(), strict=True))


def test_two_chairs_are_two_objects_and_the_floor_is_none(furnished):
    floor = [((-1.0, -0.1, -1.0), (3.0, 0.0, 1.0))]
    mesh, numbers = furnished(("floor", floor), ("chair", chair(0.0)), ("chair", chair(0.55)))
    found = find_objects(mesh)
    assert found.labels == ("chair", "chair")
    pairs = groups(found.face_object, numbers)
    assert (-1, 0) in pairs
    assert len(pairs) == 3  # each thing is one object, and each object one thing


def test_what_touches_is_one_object_unless_its_labels_differ(furnished):
    top = [((-0.1, 0.5, -0.1), (1.5, 0.55, 0.5))]  # lies on both seats
    mesh, _ = furnished(("chair", chair(0.0)), ("chair", chair(0.55)), ("table", top))
    assert sorted(find_objects(mesh).labels) == ["chair", "chair", "table"]
    mesh, _ = furnished(("chair", chair(0.0)), ("chair", chair(0.55)), ("chair", top))
    assert find_objects(mesh).labels == ("chair",)


@pytest.mark.parametrize("apart", [0.03, 0.11])
def test_the_gap_decides(furnished, apart):
    boxes = [((0.0, 0.0, 0.0), (1.0, 1.0, 1.0)), ((1.0 + apart, 0.0, 0.0), (2.0, 1.0, 1.0))]
    mesh, _ = furnished(*(("table", [box]) for box in boxes))
    assert len(find_objects(mesh, gap=0.05).labels) == (1 if apart < 0.05 else 2)


def test_a_scene_without_labels_has_no_objects(mesh_of, slab):
    found = find_objects(mesh_of(slab((0, 0, 0), (1, 1, 1))))
    assert found.labels == ()
    assert (found.face_object == -1).all()


def test_the_objects_of_a_flat_are_the_pieces_that_were_placed_in_it(monkeypatch):
    placed: Counter[str] = Counter()
    add = MeshBuilder.add

    def count(self, model, placement):
        placed.update({part.label for part in model.parts})
        add(self, model, placement)

    monkeypatch.setattr(MeshBuilder, "add", count)
    mesh = apartment(200_001).mesh
    found = find_objects(mesh)
    counts = Counter(found.labels)
    assert placed["chair"] == 6
    for label in ("bed", "nightstand", "wardrobe", "sofa", "armchair", "chair", "stool", "table", "desk", "shelf",
                  "refrigerator", "bathtub", "toilet", "radiator", "picture", "lamp", "curtain"):  # fmt: skip
        assert counts[label] == placed[label], label
    for number, label in enumerate(found.labels):
        assert {mesh.label_names[i] for i in np.unique(mesh.face_label[found.face_object == number])} == {label}


def test_objects_that_the_scene_tells_apart_are_taken_as_they_are(mesh_of, slab):
    """Two chairs that touch are two, the two halves of a third one are one, and a wall is none."""
    parts = [slab([k, 0, 0], [k + 1, 1, 1]) for k in range(5)]
    mesh = mesh_of(*parts)
    part = np.repeat(np.arange(5), 12)
    told = replace(
        mesh,
        face_label=np.array([1, 1, 1, 1, 0], np.int32)[part],
        face_object=np.array([40, 41, 7, 7, 3], np.int32)[part],
        label_names=("wall", "chair"),
    )
    found = find_objects(told)
    assert found.labels == ("chair",) * 3
    assert [np.unique(found.face_object[part == k]).tolist() for k in range(5)] == [[1], [2], [0], [0], [-1]]
