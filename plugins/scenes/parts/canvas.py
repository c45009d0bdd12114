"""Drawing of periodic textures: band-limited noise, soft edges and colour mixing.

Only additions, multiplications, divisions and square roots are used, one numpy operation at a time: IEEE 754 fixes
their results to the last bit, so that a texture has the same bytes on every machine. While they are made, images are
3 x size x size float32 in the range of uint8.
"""

import numpy as np

from deux_plugins.scenes.parts.draws import Draws

Color = tuple[int, int, int]

FULL_SIZE = 512
"""Edge of the largest texture in texels."""

OCTAVES = (2, 4, 8, 16, 32, 64, 128)
"""Lattice cells of the noise per edge of the texture. The finest spans four texels of the largest texture, which
keeps the structure above the limit where bilinear sampling flickers."""

UNIT_DEVIATION = 2.33
"""Makes the standard deviation of smoothly interpolated numbers from [-1, 1) one: sqrt(3) x 35 / 26."""


def smoothstep(t: np.ndarray) -> np.ndarray:
    """3 t^2 - 2 t^3, for t in [0, 1]."""
    return t * t * (3.0 - 2.0 * t)


def triangle(t: np.ndarray) -> np.ndarray:
    """A smooth wave of period 1 between 0 and 1."""
    return smoothstep(np.abs(2.0 * (t - np.floor(t)) - 1.0))


def lattice_noise(lattice: np.ndarray, height: int, width: int) -> np.ndarray:
    """Smooth periodic interpolation of rows x columns random numbers to height x width, unit deviation."""
    columns = _interpolate(lattice.T, width).T
    return _interpolate(columns, height) * np.float32(UNIT_DEVIATION)


def _interpolate(lattice: np.ndarray, size: int) -> np.ndarray:
    cells = len(lattice)
    position = (np.arange(size) * cells).astype(np.float32) / np.float32(size)
    first = position.astype(np.int64)
    weight = smoothstep(position - first.astype(np.float32))[:, None]
    here, there = lattice[first], lattice[(first + 1) % cells]
    return here + (there - here) * weight


class NoiseBank:
    """One noise field for each octave, shared by all textures of a flat and shifted for each use."""

    def __init__(self, draws: Draws) -> None:
        self._fields = {
            cells: np.ascontiguousarray(lattice_noise(draws.field(cells, cells), FULL_SIZE, FULL_SIZE))
            for cells in OCTAVES
        }

    def octave(self, cells: int, size: int, draws: Draws) -> np.ndarray:
        """The octave with `cells` cells per edge as size x size float32, shifted and perhaps transposed."""
        field = self._fields[cells][:: FULL_SIZE // size, :: FULL_SIZE // size]
        shift = (draws.integer(0, size - 1), draws.integer(0, size - 1))
        return np.roll(field.T if draws.chance(0.5) else field, shift, axis=(0, 1))


class Canvas:
    """A square texture that repeats in both directions; row 0 is its top.

    Args:
        size: edge in texels, 512 or 256.
        draws: the texture's random choices.
        bank: the flat's noise.

    `y` (size x 1) and `x` (1 x size) hold the texels' coordinates, float32.
    """

    def __init__(self, size: int, draws: Draws, bank: NoiseBank) -> None:
        self.size = size
        self.draws = draws
        self._bank = bank
        self.y = np.arange(size, dtype=np.float32)[:, None]
        self.x = np.arange(size, dtype=np.float32)[None, :]

    def mottle(self, first: int, last: int, gain: float = 0.75) -> np.ndarray:
        """Sum of the octaves from `first` to `last` cells per edge, each `gain` times the one before; deviation 1."""
        total = np.zeros((self.size, self.size), dtype=np.float32)
        amplitude, power = 1.0, 0.0
        for cells in OCTAVES:
            if first <= cells <= min(last, self.size // 4):
                total += self._bank.octave(cells, self.size, self.draws) * np.float32(amplitude)
                power += amplitude * amplitude
                amplitude *= gain
        return total / np.sqrt(np.float32(power))

    def streaks(self, rows: int, columns: int) -> np.ndarray:
        """Noise with another number of lattice rows than columns; deviation 1."""
        return lattice_noise(self.draws.field(rows, columns), self.size, self.size)

    def veins(self, first: int, last: int, sharpness: float = 3.0) -> np.ndarray:
        """Thin winding lines, 1 on the line, 0 away from it."""
        return np.clip(1.0 - np.abs(self.mottle(first, last, 0.6)) * np.float32(sharpness), 0.0, 1.0)

    def cells(self, rows: int, columns: int, stagger: bool = False) -> tuple[np.ndarray, ...]:
        """Divide the canvas into a lattice of cells, every other row shifted by half a cell if `stagger`.

        Returns four size x size arrays: row and column of each texel's cell (int64), and its place in the cell
        (vertical, horizontal) in [-1, 1).
        """
        height, width = np.float32(self.size / rows), np.float32(self.size / columns)
        row = np.floor(self.y / height)
        shifts = np.array([[0.0], [0.5 if stagger else 0.0]], dtype=np.float32) * width
        x = (self.x + shifts) % np.float32(self.size)
        column = np.floor(x / width)
        horizontal = (x / width - column) * 2.0 - 1.0
        vertical = (self.y / height - row) * 2.0 - 1.0
        row = row.astype(np.int64)
        odd, shape = row[:, 0] % 2, (self.size, self.size)
        places = np.broadcast_to(row, shape), column.astype(np.int64)[odd], np.broadcast_to(vertical, shape)
        return *places, horizontal[odd]

    def joints(self, rows: int, columns: int, stagger: bool = False, width: float = 1.5) -> np.ndarray:
        """The same lattice's joints: 0 on the border of a cell, rising to 1 beyond `width` texels."""
        _, _, vertical, horizontal = self.cells(rows, columns, stagger)
        to_row = (1.0 - np.abs(vertical)) * np.float32(self.size / rows / 2)
        to_column = (1.0 - np.abs(horizontal)) * np.float32(self.size / columns / 2)
        return smoothstep(np.clip((np.minimum(to_row, to_column) - np.float32(width - 1.0)) / 2.0, 0.0, 1.0))

    def tint(self, color: Color, spread: int = 12) -> Color:
        """A colour near this one."""
        jitter = [self.draws.integer(-spread, spread) for _ in color]
        red, green, blue = (min(max(value + change, 0), 255) for value, change in zip(color, jitter, strict=True))
        return red, green, blue

    def blend(self, dark: Color | np.ndarray, light: Color | np.ndarray, t: np.ndarray) -> np.ndarray:
        """From `dark` where t <= 0 to `light` where t >= 1; colours or 3 x size x size images."""
        low, high = planes(dark), planes(light)
        image = np.clip(t, 0.0, 1.0).astype(np.float32) * (high - low)
        image += low
        return image


def scaled(color: Color, factor: float) -> Color:
    """A colour made darker or lighter."""
    red, green, blue = (min(int(value * factor + 0.5), 255) for value in color)
    return red, green, blue


def planes(color: Color | np.ndarray) -> np.ndarray:
    """A colour as 3 x 1 x 1 float32; an image as it is."""
    return color if isinstance(color, np.ndarray) else np.array(color, dtype=np.float32)[:, None, None]


def to_bytes(image: np.ndarray) -> np.ndarray:
    """A 3 x size x size float image as size x size x 3 uint8."""
    return np.ascontiguousarray(np.clip(image + np.float32(0.5), 0.0, 255.0).astype(np.uint8).transpose(1, 2, 0))
