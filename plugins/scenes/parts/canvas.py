"""Drawing of periodic textures: band-limited noise, soft edges and colour mixing.

Only additions, multiplications, divisions and square roots are used, one NumPy operation at a time: IEEE 754 defines
their results exactly, so that textures are byte by byte the same on every machine. Intermediate images are 3 x size x
size float32 in [0, 255].
"""

import numpy as np

from deux_plugins.scenes.parts.draws import Draws

Color = tuple[int, int, int]

FULL_SIZE = 512
"""Edge of the largest texture in texels."""

OCTAVES = (2, 4, 8, 16, 32, 64, 128)
"""Lattice cells of the noise per edge of the texture. The finest cell is four texels of the largest texture, large
enough to avoid aliasing by bilinear sampling."""

UNIT_DEVIATION = 2.33
"""Normalises smoothly interpolated uniform numbers from [-1, 1) to unit standard deviation: sqrt(3) x 35 / 26."""


def smoothstep(t: np.ndarray) -> np.ndarray:
    """3 t^2 - 2 t^3, for t in [0, 1]."""
    return t * t * (3.0 - 2.0 * t)


def triangle(t: np.ndarray) -> np.ndarray:
    """A smooth wave of period 1 between 0 and 1."""
    return smoothstep(np.abs(2.0 * (t - np.floor(t)) - 1.0))


def lattice_noise(lattice: np.ndarray, height: int, width: int) -> np.ndarray:
    """Smooth periodic interpolation of rows x columns random numbers to height x width, with unit deviation."""
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
    """One noise field for each octave, shared by all textures of a scene and shifted for each use."""

    def __init__(self, draws: Draws) -> None:
        self._fields = {
            cells: np.ascontiguousarray(lattice_noise(draws.field(cells, cells), FULL_SIZE, FULL_SIZE))
            for cells in OCTAVES
        }

    def octave(self, cells: int, size: int, draws: Draws) -> np.ndarray:
        """The octave with `cells` cells per edge, size x size float32, randomly shifted and transposed."""
        field = self._fields[cells][:: FULL_SIZE // size, :: FULL_SIZE // size]
        shift = (draws.integer(0, size - 1), draws.integer(0, size - 1))
        return np.roll(field.T if draws.chance(0.5) else field, shift, axis=(0, 1))


class Canvas:
    """A square texture that repeats in both directions; row 0 is its top.

    Args:
        size: edge in texels, 512 or 256.
        draws: the random numbers of the texture.
        bank: the noise of the scene.

    `y` (size x 1) and `x` (1 x size) are the texels' coordinates, float32.
    """

    def __init__(self, size: int, draws: Draws, bank: NoiseBank) -> None:
        self.size = size
        self.draws = draws
        self._bank = bank
        self.y = np.arange(size, dtype=np.float32)[:, None]
        self.x = np.arange(size, dtype=np.float32)[None, :]

    def mottle(self, first: int, last: int, gain: float = 0.75) -> np.ndarray:
        """Sum of the octaves from `first` to `last` cells per edge, each weighted `gain` times the previous one.

        The result has unit deviation.
        """
        total = np.zeros((self.size, self.size), dtype=np.float32)
        amplitude, power = 1.0, 0.0
        for cells in OCTAVES:
            if first <= cells <= min(last, self.size // 4):
                total += self._bank.octave(cells, self.size, self.draws) * np.float32(amplitude)
                power += amplitude * amplitude
                amplitude *= gain
        return total / np.sqrt(np.float32(power))

    def streaks(self, rows: int, columns: int) -> np.ndarray:
        """Anisotropic noise: a lattice of rows x columns; unit deviation."""
        return lattice_noise(self.draws.field(rows, columns), self.size, self.size)

    def veins(self, first: int, last: int, sharpness: float = 3.0) -> np.ndarray:
        """Thin winding lines: 1 on the line, 0 elsewhere."""
        return np.clip(1.0 - np.abs(self.mottle(first, last, 0.6)) * np.float32(sharpness), 0.0, 1.0)

    def cells(self, rows: int, columns: int, stagger: bool = False) -> tuple[np.ndarray, ...]:
        """Divide the canvas into a lattice of cells, with every other row shifted by half a cell if `stagger`.

        Returns:
            Four size x size arrays: row and column of each texel's cell (int64), and the texel's vertical and
            horizontal position in the cell, in [-1, 1).
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
        """The joints of the lattice of `cells`: 0 on the border of a cell, increasing to 1 beyond `width` texels."""
        _, _, vertical, horizontal = self.cells(rows, columns, stagger)
        to_row = (1.0 - np.abs(vertical)) * np.float32(self.size / rows / 2)
        to_column = (1.0 - np.abs(horizontal)) * np.float32(self.size / columns / 2)
        return smoothstep(np.clip((np.minimum(to_row, to_column) - np.float32(width - 1.0)) / 2.0, 0.0, 1.0))

    def tint(self, color: Color, spread: int = 12) -> Color:
        """A random colour near the given one."""
        jitter = [self.draws.integer(-spread, spread) for _ in color]
        red, green, blue = (min(max(value + change, 0), 255) for value, change in zip(color, jitter, strict=True))
        return red, green, blue

    def blend(self, dark: Color | np.ndarray, light: Color | np.ndarray, t: np.ndarray) -> np.ndarray:
        """Interpolate from `dark` (t <= 0) to `light` (t >= 1); both are colours or 3 x size x size images."""
        low, high = planes(dark), planes(light)
        image = np.clip(t, 0.0, 1.0).astype(np.float32) * (high - low)
        image += low
        return image


def scaled(color: Color, factor: float) -> Color:
    """A darker or lighter colour."""
    red, green, blue = (min(int(value * factor + 0.5), 255) for value in color)
    return red, green, blue


def planes(color: Color | np.ndarray) -> np.ndarray:
    """Convert a colour to 3 x 1 x 1 float32; an image is returned as it is."""
    return color if isinstance(color, np.ndarray) else np.array(color, dtype=np.float32)[:, None, None]


def to_bytes(image: np.ndarray) -> np.ndarray:
    """Convert a 3 x size x size float image to size x size x 3 uint8."""
    return np.ascontiguousarray(np.clip(image + np.float32(0.5), 0.0, 255.0).astype(np.uint8).transpose(1, 2, 0))
