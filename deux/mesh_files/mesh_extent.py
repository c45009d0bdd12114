"""How large a mesh is: stray triangles, and units that are not metres."""

import math
from pathlib import Path

import numpy as np

from deux.errors import DeuxError

LARGEST = 250.0
"""Metres: the longest side of a scene, which bounds the grids over its floor."""

_GAP = 50.0  # metres of nothing between a building and what is not part of it
_STRAY = 0.1  # the largest part of all area that is taken for stray
_UNITS = {
    "metres": 1.0,
    "centimetres": 0.01,
    "millimetres": 0.001,
    "inches": 0.0254,
    "feet": 0.3048,
    "kilometres": 1000.0,
}
_HEIGHTS = (1.8, 30.0)  # metres, of a building's inside
_STOREY = 2.7  # metres


def near_faces(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Which faces belong to the scene, F bool; the others are stray, far from it and of little area.

    Along each axis, faces that are separated by more than 50 m of nothing are groups; the group with the most area is
    the scene. Where the others have a tenth of all area or more, nothing is stray.

    Args:
        vertices: V x 3, metres.
        faces: F x 3.
    """
    near = np.ones(len(faces), bool)
    used = vertices[faces.ravel()] if len(faces) * 3 < len(vertices) else vertices
    if (np.ptp(used, axis=0) <= _GAP).all():
        return near
    area = _areas(vertices, faces)
    for axis in range(3):
        position = vertices[faces, axis]
        low, high = position.min(axis=1), position.max(axis=1)
        order = np.argsort(low)
        reached = np.maximum.accumulate(high[order])
        group = np.empty(len(faces), np.int64)
        group[order] = np.concatenate([[0], np.cumsum(low[order][1:] > reached[:-1] + _GAP)])
        share = np.bincount(group, area)
        near &= group == share.argmax()
    return near if area[~near].sum() < _STRAY * area.sum() else np.ones(len(faces), bool)


def check_extent(path: Path, bounds: np.ndarray, scale: float) -> None:
    """Check that a mesh can be a building in metres, before any memory is asked for that grows with its size.

    Args:
        path: the file, for the message.
        bounds: 2 x 3, the least and the greatest corner in metres.
        scale: metres per unit of the file that are assumed.

    Raises:
        DeuxError: it is larger than `LARGEST`.
    """
    size = bounds[1] - bounds[0]
    if size.max() > LARGEST:
        raise DeuxError(
            f"{path} is {describe_size(bounds)} large, but a scene is at most {LARGEST:.0f} m long: "
            f"{unit_advice(bounds, scale)}."
        )


def describe_size(bounds: np.ndarray) -> str:
    """A text such as "10.3 x 3.1 x 11.2 m"."""
    return " x ".join(f"{side:.3g}" if side < 100 else f"{side:.0f}" for side in bounds[1] - bounds[0]) + " m"


def unit_advice(bounds: np.ndarray, scale: float) -> str:
    """In which unit a mesh may be whose size is no building's, and the option that says so.

    Args:
        bounds: 2 x 3, the least and the greatest corner in metres.
        scale: metres per unit of the file that are assumed.
    """
    size = (bounds[1] - bounds[0]) / scale
    likely = {
        name: abs(math.log(size[1] * unit / _STOREY))
        for name, unit in _UNITS.items()
        if unit != scale  # that has just been found wrong
        if _HEIGHTS[0] <= size[1] * unit <= _HEIGHTS[1] and size[[0, 2]].min() * unit >= 1.0
        if size.max() * unit <= LARGEST
    }
    if not likely:
        return "is it in metres, and free of stray triangles? scenes.scale= says how many metres a unit of the file is"
    unit = min(likely, key=lambda name: likely[name])
    return f"it seems to be in {unit}, set scenes.scale={_UNITS[unit]:g} (metres per unit of the file)"


def _areas(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    first = vertices[faces[:, 0]]
    normals = np.cross(vertices[faces[:, 1]] - first, vertices[faces[:, 2]] - first)
    return 0.5 * np.sqrt(np.einsum("fc,fc->f", normals, normals))
