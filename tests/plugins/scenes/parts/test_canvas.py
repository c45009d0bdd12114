"""Noise and patterns that textures are made of."""

import numpy as np
import pytest

from deux_plugins.scenes.parts.canvas import Canvas, NoiseBank, lattice_noise, planes, to_bytes
from deux_plugins.scenes.parts.draws import Draws


@pytest.fixture
def canvas() -> Canvas:
    return Canvas(256, Draws(0, "texture"), NoiseBank(Draws(0, "noise")))


def test_mottle_has_unit_deviation_and_the_asked_scale(canvas: Canvas):
    coarse, fine = canvas.mottle(2, 4), canvas.mottle(32, 64)
    assert coarse.dtype == np.float32
    assert canvas.mottle(4, 64).std() == pytest.approx(1.0, abs=0.25)
    assert fine.std() == pytest.approx(1.0, abs=0.1)
    steps = [np.abs(np.diff(field, axis=0)).mean() for field in (coarse, fine)]
    assert steps[1] > 5 * steps[0]


def test_noise_goes_through_its_lattice_and_repeats():
    lattice = Draws(0, "lattice").field(8, 4)
    noise = lattice_noise(lattice, 64, 64)
    assert noise[::8, ::16] == pytest.approx(lattice * 2.33, rel=1e-5)
    jump = np.abs(noise[0] - noise[-1]).max()
    assert jump <= np.abs(np.diff(noise, axis=0)).max()


@pytest.mark.parametrize("stagger", [False, True])
def test_cells_number_the_lattice(canvas: Canvas, stagger: bool):
    row, column, vertical, horizontal = canvas.cells(8, 4, stagger)
    assert (row[:, 0] == np.arange(256) // 32).all()
    assert {*np.unique(column)} == {0, 1, 2, 3}
    assert (np.unique(row * 4 + column, return_counts=True)[1] == 256 * 256 // 32).all()
    for place in (vertical, horizontal):
        assert (place.min(), place.max()) == pytest.approx((-1.0, 0.95), abs=0.05)
    assert (column[40, 0] != column[40, 40]) == stagger


def test_joints_are_dark_at_the_borders_only(canvas: Canvas):
    joints = canvas.joints(4, 4)
    assert joints[64].max() == 0.0
    assert joints[32, 32] == 1.0


def test_blend_mixes_colours_and_images(canvas: Canvas):
    t = np.linspace(-0.5, 1.5, 256 * 256, dtype=np.float32).reshape(256, 256)
    image = canvas.blend((0, 100, 200), (200, 100, 0), t)
    assert image[:, 0, 0].tolist() == [0, 100, 200]
    assert image[:, -1, -1].tolist() == [200, 100, 0]
    again = canvas.blend(image, planes((7, 7, 7)), np.ones((256, 256)))
    assert (again == 7).all()
    assert to_bytes(image).shape == (256, 256, 3)


def test_draws_of_different_streams_are_independent_and_in_range():
    first, second, again = Draws(3, "a"), Draws(3, "b"), Draws(3, "a")
    numbers = [first.uniform(2.0, 3.0) for _ in range(200)]
    assert numbers != [second.uniform(2.0, 3.0) for _ in range(200)]
    assert numbers == [again.uniform(2.0, 3.0) for _ in range(200)]
    assert 2.0 <= min(numbers) < 2.05 < 2.95 < max(numbers) <= 3.0
    assert {first.integer(1, 4) for _ in range(200)} == {1, 2, 3, 4}
