"""Solids against their volumes: the divergence theorem gives it only for closed surfaces that look outward."""

import math

import numpy as np
import pytest

from deux_plugins.scenes.parts.mesh_builder import EAST, Placement
from deux_plugins.scenes.parts.shapes import Model, rectangle
from deux_plugins.scenes.parts.surfaces import MATERIAL_KINDS, Surface

PLAIN, WOOD, PICTURE = Surface("marble", 0), Surface("wood", 0), Surface("abstract", 0)


def volume(corners: np.ndarray) -> float:
    """Of the solid enclosed by N x 4 x 3 quadrilaterals: a sixth of the sum of a . (b x c) over all triangles."""
    triangles = np.concatenate([corners[:, [0, 1, 2]], corners[:, [0, 2, 3]]])
    return float((triangles[:, 0] * np.cross(triangles[:, 1], triangles[:, 2])).sum() / 6)


def all_corners(model: Model) -> np.ndarray:
    return np.concatenate([part.corners for part in model.parts])


def test_a_box_is_closed_and_looks_outward():
    model = Model("box", 1, 1, 1, hangs=True)
    model.box((-0.2, 0.0, 0.1), (0.3, 0.4, 0.9), PLAIN, front=PICTURE)
    assert volume(all_corners(model)) == pytest.approx(0.5 * 0.4 * 0.8)
    assert len(all_corners(model)) == 6


def test_a_standing_box_has_no_underside():
    model = Model("box", 1, 1, 1)
    model.box((0, 0, 0), (1, 1, 1), PLAIN)
    model.box((0, 2, 0), (1, 3, 1), PLAIN)
    assert [len(part.corners) for part in model.parts] == [5, 6]


def test_the_front_of_a_box_has_its_own_surface():
    model = Model("tv", 1, 1, 1)
    model.box((0, 1, 0), (1, 2, 1), PLAIN, front=PICTURE, label="picture")
    front = next(part for part in model.parts if part.surface == PICTURE)
    assert (front.corners[..., 2] == 1).all()
    assert front.label == "picture"
    assert front.uv[0].tolist() == [[0, 0], [1, 0], [1, 1], [0, 1]]


@pytest.mark.parametrize("axis", ["y", "z"])
@pytest.mark.parametrize("sides", [6, 8, 12])
def test_a_turned_solid_has_the_volume_of_its_frustums(axis: str, sides: int):
    model = Model("vase", 1, 1, 1, hangs=True)
    model.turned((0.3, 0.2, 0.1), [(0.0, 0.1), (0.3, 0.2), (0.4, 0.05)], PLAIN, sides=sides, axis=axis)
    polygon = sides / 2 * math.sin(2 * math.pi / sides)
    frustums = [h / 3 * (a * a + a * b + b * b) * polygon for h, a, b in ((0.3, 0.1, 0.2), (0.1, 0.2, 0.05))]
    assert volume(all_corners(model)) == pytest.approx(sum(frustums), rel=1e-4)


def test_a_standing_turned_solid_has_no_lower_cap():
    hanging, standing = Model("vase", 1, 1, 1, hangs=True), Model("vase", 1, 1, 1)
    for model in (hanging, standing):
        model.turned((0, 0, 0), [(0.0, 0.1), (0.3, 0.1)], PLAIN, sides=8)
    assert len(all_corners(hanging)) - len(all_corners(standing)) == 3
    assert not (all_corners(standing)[..., 1] == 0).all(axis=1).any()


def test_texture_coordinates_are_metres_and_follow_the_grain():
    upright = rectangle((0, 0, 0), (0.2, 0, 0), (0, 1.5, 0), WOOD, "shelf")
    level = rectangle((0, 0, 0), (1.5, 0, 0), (0, 0.2, 0), WOOD, "shelf")
    plain = rectangle((0, 0, 0), (0.2, 0, 0), (0, 1.5, 0), PLAIN, "shelf")
    assert MATERIAL_KINDS["wood"].grain
    for quads, extent in ((upright, (1.5, 0.2)), (level, (1.5, 0.2)), (plain, (0.2, 1.5))):
        assert np.ptp(quads.uv[0], axis=0) == pytest.approx(extent)


def test_a_model_on_another_one_is_moved_with_its_label():
    table, vase = Model("table", 1, 1, 1), Model("vase", 0.1, 0.1, 0.2)
    vase.box((-0.05, 0, 0), (0.05, 0.2, 0.1), PLAIN)
    table.add(vase, 0.3, 0.7, 0.2)
    corners = table.parts[0].corners.reshape(-1, 3)
    assert corners.min(axis=0) == pytest.approx((0.25, 0.7, 0.2))
    assert table.parts[0].label == "vase"


def test_placements_turn_to_the_right_and_keep_volumes():
    placement = Placement(2.0, 3.0, EAST, 0.5)
    front = placement.apply(np.array([0.0, 0.0, 1.0]))
    assert front == pytest.approx((3.0, 0.5, 3.0))
    assert (placement.beside(0.0, 1.0).x, placement.beside(0.0, 1.0).z) == pytest.approx((3.0, 3.0))
    model = Model("box", 1, 1, 1, hangs=True)
    model.box((0, 0, 0), (1, 2, 3), PLAIN)
    assert volume(placement.apply(all_corners(model))) == pytest.approx(6.0)
