"""Top-down grids that grow with the known part of the floor."""

import math

import numpy as np

from deux.geometry.grid import GridFrame
from deux.memory_budget import check_memory


class GrowingGrid:
    """Named arrays over one top-down grid that can be enlarged.

    Cell edges are at multiples of the resolution in world coordinates, so that grids of equal resolution have aligned
    cells. New cells are 0.

    Args:
        resolution: edge of a cell in metres.
        layers: the arrays, name -> dtype.
    """

    margin = 2.0
    """Metres added beyond the requested extent, so that the arrays are rarely copied."""

    def __init__(self, resolution: float, layers: dict[str, type]) -> None:
        self._resolution = resolution
        self._first_row = self._first_column = 0
        self._layers: dict[str, np.ndarray] = {name: np.zeros((0, 0), dtype) for name, dtype in layers.items()}

    def __getitem__(self, name: str) -> np.ndarray:
        """The array of one layer, rows x columns; a new object after the grid has grown."""
        return self._layers[name]

    @property
    def frame(self) -> GridFrame:
        """The arrays' frame; 0 x 0 before the first `cover`."""
        rows, columns = next(iter(self._layers.values())).shape
        origin_x, origin_z = self._first_column * self._resolution, self._first_row * self._resolution
        return GridFrame(origin_x, origin_z, rows, columns, self._resolution)

    def cover(self, x: float, z: float, reach: float) -> None:
        """Grow to include every cell within `reach` metres of world point (x, z) along each axis.

        Raises:
            DeuxError: the grid would not fit into memory, since the point is far from all others.
        """
        needed = [math.floor(value / self._resolution) for value in (z - reach, x - reach, z + reach, x + reach)]
        rows, columns = self.frame.shape
        held = [
            self._first_row,
            self._first_column,
            self._first_row + rows - 1,
            self._first_column + columns - 1,
        ]
        extra = math.ceil(self.margin / self._resolution)
        if rows == 0:
            first, last = [n - extra for n in needed[:2]], [n + extra for n in needed[2:]]
        else:
            first = [h if n >= h else n - extra for n, h in zip(needed[:2], held[:2], strict=True)]
            last = [h if n <= h else n + extra for n, h in zip(needed[2:], held[2:], strict=True)]
            if first == held[:2] and last == held[2:]:
                return
        shape = (last[0] - first[0] + 1, last[1] - first[1] + 1)
        cell = sum(layer.itemsize for layer in self._layers.values())
        width, depth = shape[1] * self._resolution, shape[0] * self._resolution
        check_memory(
            2 * cell * shape[0] * shape[1],
            f"the map of {width:,.0f} x {depth:,.0f} m that the pose at x={x:g}, z={z:g} leads to",
            "poses of one episode lie in one building, so this one is wrong",
        )
        top, left = self._first_row - first[0], self._first_column - first[1]
        for name, layer in self._layers.items():
            grown = np.zeros(shape, layer.dtype)
            if rows:
                grown[top : top + rows, left : left + columns] = layer
            self._layers[name] = grown
        self._first_row, self._first_column = first
