"""Baked light."""

import numpy as np

from deux_plugins.scenes.parts.lighting import Light, shade

ROOM = Light((0.0, 0.0, 4.0, 4.0), 2.5, (1.0, 1.0, 1.0))
OTHER = Light((5.0, 0.0, 9.0, 4.0), 2.5, (1.0, 0.8, 0.6))


def level(x: float, y: float, z: float, up: bool = True) -> np.ndarray:
    """A small level square, 1 x 4 x 3."""
    corners = np.array([[x, y, z + 0.1], [x + 0.1, y, z + 0.1], [x + 0.1, y, z], [x, y, z]])
    return (corners if up else corners[::-1])[None]


def test_floor_is_brightest_under_the_lamp():
    assert shade(level(2.0, 0.0, 2.0), [ROOM]).mean() > shade(level(1.0, 0.0, 0.6), [ROOM]).mean()


def test_faces_that_look_away_from_the_lamp_are_darker():
    assert shade(level(2.0, 1.0, 2.0), [ROOM]).mean() > shade(level(2.0, 1.0, 2.0, up=False), [ROOM]).mean() + 20


def test_corners_are_darker():
    assert shade(level(0.05, 0.0, 2.0), [ROOM]).mean() < shade(level(0.6, 0.0, 2.0), [ROOM]).mean() - 10


def test_each_room_has_the_colour_of_its_own_lamp():
    here, there = (shade(level(x, 0.0, 2.0), [ROOM, OTHER])[0, 0] for x in (2.0, 7.0))
    assert here[0] == here[2]
    assert there[0] > there[1] > there[2]
