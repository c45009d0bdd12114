"""The interior of a building: the part of a floor plan that is under ceilings, without gardens and terrain."""

from __future__ import annotations

import cv2
import numpy as np
from scipy import ndimage

CEILING = 20.0  # metres; the greatest height of a ceiling above its floor, such as in halls and churches
HOLE = 0.5  # metres; half the width of holes in ceilings, common in scans, that are closed
SKYLIGHT = 0.1  # greatest area of a larger hole surrounded by covered floor, as a fraction of the covered area
WING = 0.3  # least area of a separate part of a building, as a fraction of the largest part
COVERED = 0.3  # least fraction of the floor that is covered if the scene contains a building
LEAST_BUILDING = 10.0  # square metres of connected covered floor that make a building even if most floor is uncovered


def inside_building(floor: np.ndarray, covered: np.ndarray, resolution: float) -> np.ndarray | None:
    """Find the cells of a floor plan that are inside a building.

    There is a building if at least `COVERED` of the floor is covered. For a building on a large terrain it suffices
    that a connected piece of `LEAST_BUILDING` is covered and fills at least half of the floor in its bounding
    rectangle. Separate covered pieces belong to the building if they have at least `WING` of the largest one's area.

    Args:
        floor: rows x columns bool, the cells where there is floor.
        covered: rows x columns bool, the floor cells that have a ceiling within `CEILING` above.
        resolution: edge of a cell in metres.

    Returns:
        Rows x columns bool; None if there is no building, for example in scans without ceilings.
    """
    covered = covered & floor
    if not (floor & ~covered).any():
        return floor if floor.any() else None
    reach = max(HOLE / resolution, 1.0)
    margin = int(np.ceil(2 * reach)) + 1
    near = _distance(~np.pad(covered, margin)) <= reach
    closed = (_distance(near) > reach)[margin:-margin, margin:-margin] | covered
    if covered.sum() < COVERED * floor.sum() and not _stands_out(floor, closed & floor, resolution):
        return None
    closed = _large_pieces(closed)
    holes, count = ndimage.label(ndimage.binary_fill_holes(closed) & ~closed)
    sizes = np.bincount((holes * floor).ravel(), minlength=count + 1)
    small = sizes <= SKYLIGHT * covered.sum()
    small[0] = False
    inside: np.ndarray = closed | small[holes]
    return inside


def _large_pieces(covered: np.ndarray) -> np.ndarray:
    """The connected pieces with at least `WING` of the largest one's area, which excludes trees, bus stops, kennels."""
    pieces, count = ndimage.label(covered)
    sizes = np.bincount(pieces.ravel(), minlength=count + 1)
    sizes[0] = 0
    large: np.ndarray = (sizes >= WING * sizes.max())[pieces] & covered
    return large


def _distance(cells: np.ndarray) -> np.ndarray:
    """Distance in cells from each true cell to the nearest false cell; 0 for false cells."""
    distance: np.ndarray = cv2.distanceTransform(cells.astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    return distance


def _stands_out(floor: np.ndarray, covered: np.ndarray, resolution: float) -> bool:
    """Whether the largest covered piece of a floor is large and compact enough to be a building."""
    pieces, count = ndimage.label(covered)
    if count == 0:
        return False
    sizes = np.bincount(pieces.ravel())
    sizes[0] = 0
    around = ndimage.find_objects(pieces)[sizes.argmax() - 1]
    return bool(sizes.max() * resolution**2 >= LEAST_BUILDING and sizes.max() >= 0.5 * floor[around].sum())
