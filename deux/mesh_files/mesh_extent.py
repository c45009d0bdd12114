"""The extent of a mesh: detection of stray triangles, and of units other than metres."""

import math
from pathlib import Path

import numpy as np

from deux.errors import DeuxError

LARGEST = 250.0
"""Greatest side of a scene in metres, which limits the grids over its floor."""

_GAP = 50.0  # metres of empty space between a building and stray triangles
_STRAY = 0.1  # greatest fraction of the area that can be stray
_UNITS = {
    "metres": 1.0,
    "centimetres": 0.01,
    "millimetres": 0.001,
    "inches": 0.0254,
    "feet": 0.3048,
    "kilometres": 1000.0,
}
_HEIGHTS = (1.8, 30.0)  # metres; plausible heights of a building's interior
_STOREY = 2.7  # metres; typical height of a storey


def near_faces(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Find the faces that are not stray, F bool. Stray faces are far from the scene and have a small area.

    Along each axis, faces are grouped by gaps of more than 50 m; the group with the largest area is the scene. If the
    others have at least a tenth of the total area, no face is stray.

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
        area_of_group = np.bincount(group, area)
        near &= group == area_of_group.argmax()
    return near if area[~near].sum() < _STRAY * area.sum() else np.ones(len(faces), bool)


def check_extent(path: Path, bounds: np.ndarray, scale: float) -> None:
    """Check that a mesh is not too large for a building in metres, before memory is allocated for its floor plan.

    Args:
        path: the file, for the message.
        bounds: 2 x 3, the least and the greatest corner in metres.
        scale: the assumed metres per unit of the file.

    Raises:
        DeuxError: the mesh is larger than `LARGEST`.
    """
    size = bounds[1] - bounds[0]
    if size.max() > LARGEST:
        raise DeuxError(
            f"{path} is {describe_size(bounds)} large, but a scene must be at most {LARGEST:.0f} m long: "
            f"{unit_advice(bounds, scale)}."
        )


def describe_size(bounds: np.ndarray) -> str:
    """Format a size, such as "10.3 x 3.1 x 11.2 m"."""
    return " x ".join(f"{side:.3g}" if side < 100 else f"{side:.0f}" for side in bounds[1] - bounds[0]) + " m"


def unit_advice(bounds: np.ndarray, scale: float) -> str:
    """The likely unit of a mesh with an implausible size, and the option to set, for the end of a sentence.

    Args:
        bounds: 2 x 3, the least and the greatest corner in metres.
        scale: the assumed metres per unit of the file.
    """
    size = (bounds[1] - bounds[0]) / scale
    likely = {
        name: abs(math.log(size[1] * unit / _STOREY))
        for name, unit in _UNITS.items()
        if unit != scale  # which is known to be wrong
        if _HEIGHTS[0] <= size[1] * unit <= _HEIGHTS[1] and size[[0, 2]].min() * unit >= 1.0
        if size.max() * unit <= LARGEST
    }
    if not likely:
        return "is it in metres, and free of stray triangles? scenes.scale= sets the metres per unit of the file"
    unit = min(likely, key=lambda name: likely[name])
    return f"it seems to be in {unit}, set scenes.scale={_UNITS[unit]:g} (metres per unit of the file)"


def _areas(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    first = vertices[faces[:, 0]]
    normals = np.cross(vertices[faces[:, 1]] - first, vertices[faces[:, 2]] - first)
    return 0.5 * np.sqrt(np.einsum("fc,fc->f", normals, normals))
