"""The inside of a building: the part of a floor that lies under its ceilings, as opposed to gardens and terrain."""

from __future__ import annotations

import cv2
import numpy as np
from scipy import ndimage

CEILING = 20.0  # metres above a floor within which its ceiling is, in halls and churches too
HOLE = 0.5  # metres; half the width of holes in a ceiling, as scans have them, that are inside all the same
SKYLIGHT = 0.1  # greatest area of a larger hole, as a fraction of what is covered, if it has covered floor all round
WING = 0.3  # least part of a building that stands by itself, as a fraction of the largest one
COVERED = 0.3  # fraction of the floor that is under the ceilings of a building
LEAST_BUILDING = 10.0  # square metres under one roof that make a building, however much floor is around it


def inside_building(floor: np.ndarray, covered: np.ndarray, resolution: float) -> np.ndarray | None:
    """Which cells of a floor plan are inside a building.

    There is a building if at least `COVERED` of the floor is covered. On a large ground it is less: then there is one
    if `LEAST_BUILDING` is covered in one piece and fills at least half of the floor in the rectangle around it.

    Of separate covered pieces those count that have `WING` of the largest one's area.

    Args:
        floor: rows x columns bool, the cells where there is floor.
        covered: rows x columns bool, those of them that have a ceiling within `CEILING` above.
        resolution: edge of a cell in metres.

    Returns:
        Rows x columns bool; None if there is no building, as in scans without ceiling.
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
    """The connected pieces that have `WING` of the largest one's area at least: no trees, bus stops and kennels."""
    pieces, count = ndimage.label(covered)
    sizes = np.bincount(pieces.ravel(), minlength=count + 1)
    sizes[0] = 0
    large: np.ndarray = (sizes >= WING * sizes.max())[pieces] & covered
    return large


def _distance(cells: np.ndarray) -> np.ndarray:
    """Distance in cells from each of the true ones to the nearest false one, 0 for the false ones."""
    distance: np.ndarray = cv2.distanceTransform(cells.astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    return distance


def _stands_out(floor: np.ndarray, covered: np.ndarray, resolution: float) -> bool:
    """Whether the largest covered piece of a floor is large enough, and compact enough, for a building."""
    pieces, count = ndimage.label(covered)
    if count == 0:
        return False
    sizes = np.bincount(pieces.ravel())
    sizes[0] = 0
    around = ndimage.find_objects(pieces)[sizes.argmax() - 1]
    return bool(sizes.max() * resolution**2 >= LEAST_BUILDING and sizes.max() >= 0.5 * floor[around].sum())
