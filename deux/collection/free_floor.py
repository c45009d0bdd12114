"""The true free floor of each place, stored with a dataset for evaluation, and how much of it a map covers."""

import io
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from deux.errors import DeuxError, error_text
from deux.geometry.grid import FreeSpace, GridFrame
from deux.io.arrays import read_arrays
from deux.io.atomic import write_atomically
from deux.io.layout import SequencePaths
from deux.mapping.occupancy import FREE, OccupancyMap

FREE_FLOOR_FILE = "free_floor.npz"
"""File in a sequence's folder: the positions on its floor that the robot's centre can take. Privileged: neither
explorers nor models read it."""


def write_free_floor(sequence: Path, space: FreeSpace) -> None:
    """Write the free cells of a floor to a sequence's folder."""
    content, frame = io.BytesIO(), space.frame
    np.savez_compressed(
        content,
        free=space.free,
        origin=np.array([frame.origin_x, frame.origin_z]),
        resolution=np.array(frame.resolution),
    )
    write_atomically(sequence / FREE_FLOOR_FILE, content.getvalue())


def read_free_floor(sequence: SequencePaths) -> tuple[GridFrame, np.ndarray] | None:
    """Read the free floor of a sequence.

    Returns:
        The grid's frame, and rows x columns bool; None if there is no file, such as for recorded frames and datasets
        of earlier versions.

    Raises:
        DeuxError: the file is damaged.
    """
    path = sequence.folder / FREE_FLOOR_FILE
    if not path.exists():
        return None
    arrays = read_arrays(path)
    try:
        return stored_grid(arrays, arrays["free"]), arrays["free"].astype(bool)
    except (ValueError, KeyError) as error:
        raise DeuxError(f"{path} is damaged, it holds no free floor ({error_text(error)}): delete it.") from error


def stored_grid(arrays: Mapping[str, np.ndarray], cells: np.ndarray) -> GridFrame:
    """The frame of a stored grid, from the arrays "origin" (x and z) and "resolution".

    Args:
        arrays: arrays by name.
        cells: the grid, rows x columns.

    Raises:
        KeyError: an array is missing.
        ValueError: an array has the wrong shape or invalid values.
    """
    origin, resolution = arrays["origin"], arrays["resolution"]
    kinds = {origin.dtype.kind, resolution.dtype.kind}
    if cells.ndim != 2 or origin.shape != (2,) or resolution.shape != () or "c" in kinds:
        raise ValueError("its arrays have the wrong shapes or types for a grid")
    if not (np.isfinite(origin).all() and np.isfinite(resolution) and resolution > 0):
        raise ValueError("its origin and resolution are not valid")
    (x, z), (rows, columns) = origin, cells.shape
    return GridFrame(float(x), float(z), rows, columns, float(resolution))


def known_free_cells(known: OccupancyMap, frame: GridFrame, free: np.ndarray) -> int:
    """The number of cells of the true free floor whose centres lie in free cells of a map.

    Args:
        known: the map.
        frame: frame of the grid of the free floor.
        free: rows x columns bool.
    """
    rows, columns = np.nonzero(free)
    x = frame.origin_x + (columns + 0.5) * frame.resolution
    z = frame.origin_z + (rows + 0.5) * frame.resolution
    rows, columns = known.frame.cells(x, z)
    inside = known.frame.contains(rows, columns)
    return int(np.count_nonzero(known.cells[rows[inside], columns[inside]] == FREE))
