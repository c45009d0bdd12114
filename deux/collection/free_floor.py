"""The true free floor of each place, kept with a dataset to judge it by, and how much of it a map knows."""

import io
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from deux.errors import DeuxError
from deux.geometry.grid import FreeSpace, GridFrame
from deux.io.arrays import read_arrays, said
from deux.io.atomic import write_atomically
from deux.io.layout import SequencePaths
from deux.mapping.occupancy import FREE, OccupancyMap

FREE_FLOOR_FILE = "free_floor.npz"
"""In a sequence's folder: where the robot's centre could be on its floor. Privileged: no explorer and no model reads
it."""


def write_free_floor(sequence: Path, space: FreeSpace) -> None:
    """Write where a floor is free into a sequence's folder."""
    content, frame = io.BytesIO(), space.frame
    np.savez_compressed(
        content,
        free=space.free,
        origin=np.array([frame.origin_x, frame.origin_z]),
        resolution=np.array(frame.resolution),
    )
    write_atomically(sequence / FREE_FLOOR_FILE, content.getvalue())


def read_free_floor(sequence: SequencePaths) -> tuple[GridFrame, np.ndarray] | None:
    """Where the floor of a sequence is free: the grid's place in the world, and rows x columns bool.

    Returns:
        None where it is not kept: of recorded frames, and of datasets of earlier versions.

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
        raise DeuxError(f"{path} is damaged, it holds no free floor ({said(error)}): delete it.") from error


def stored_grid(arrays: Mapping[str, np.ndarray], cells: np.ndarray) -> GridFrame:
    """The grid of stored cells, by the arrays "origin" (x and z) and "resolution" beside them.

    Args:
        arrays: by name.
        cells: rows x columns.

    Raises:
        KeyError: an array is missing.
        ValueError: one has another shape or a value that is no place or size.
    """
    origin, resolution = arrays["origin"], arrays["resolution"]
    kinds = {origin.dtype.kind, resolution.dtype.kind}
    if cells.ndim != 2 or origin.shape != (2,) or resolution.shape != () or "c" in kinds:
        raise ValueError("its arrays have other shapes or types than those of a grid")
    if not (np.isfinite(origin).all() and np.isfinite(resolution) and resolution > 0):
        raise ValueError("its origin and resolution are no places and sizes")
    (x, z), (rows, columns) = origin, cells.shape
    return GridFrame(float(x), float(z), rows, columns, float(resolution))


def known_free_cells(known: OccupancyMap, frame: GridFrame, free: np.ndarray) -> int:
    """How many cells of the true free floor have their centres where a map is free.

    Args:
        known: the map.
        frame: where the grid of the free floor lies.
        free: rows x columns bool.
    """
    rows, columns = np.nonzero(free)
    x = frame.origin_x + (columns + 0.5) * frame.resolution
    z = frame.origin_z + (rows + 0.5) * frame.resolution
    rows, columns = known.frame.cells(x, z)
    inside = known.frame.contains(rows, columns)
    return int(np.count_nonzero(known.cells[rows[inside], columns[inside]] == FREE))
