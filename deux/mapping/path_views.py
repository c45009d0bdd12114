"""The value of the views along a path, each computed as if the earlier ones had already been taken."""

import numpy as np

from deux.compilation import compiled
from deux.geometry.grid import GridFrame
from deux.mapping.surface_views import SurfaceViews, views_of
from deux.mapping.view_fan import NOTHING, Rays

SHOWN_CELL = 0.4
"""Edge in metres of the cells that store what the views of one path show; rays are that far apart at 4.6 m."""


def values_along_paths(
    surfaces: SurfaceViews,
    rays: Rays,
    worth: np.ndarray,
    shares: np.ndarray,
    goal: np.ndarray,
    place: np.ndarray,
    heading: np.ndarray,
) -> np.ndarray:
    """The summed value of the views along the path to each of N places and of the view there, for V headings.

    The value of a view is the sum over its rays of share x worth x novelty. The novelty of a ray's end point is
    (1 + n) ** -(1 + s), where n is the number of different views in which it was seen (pairs of bearing and distance
    class), and s is 1 if this view is one of them, else 0. The views before it on the path count as seen.

    Args:
        surfaces: the views in which surfaces were seen until now.
        rays: rays from the N places.
        worth: N x R float64, the value of each ray's end point if it is new.
        shares: V x R float64, the part of the image that each ray represents in a view with each heading.
        goal: M int64 in increasing order, the place to whose path each further view belongs.
        place: M int64, the place from which this view is taken; ordered from the goal back to the start.
        heading: M int64, the index of its heading.

    Returns:
        N x V float64.
    """
    ends = np.where(np.isfinite(rays.ends), rays.ends, 0.0)
    least = ends.reshape(-1, 2).min(axis=0)
    lattice = GridFrame(float(least[0]), float(least[1]), 0, 0, SHOWN_CELL)
    rows, columns = lattice.cells(ends[..., 0], ends[..., 1])
    width = int(columns.max()) + 1
    cells = np.where(rays.kind == NOTHING, -1, rows * width + columns)
    first = np.searchsorted(goal, np.arange(len(cells) + 1))
    seen, views = surfaces.seen_in(rays), views_of(rays)
    return _values(cells, views, seen, worth, shares, first, place, heading, int(cells.max()) + 1)


@compiled
def _values(cells, views, seen, worth, shares, first, place, heading, count):  # type: ignore[no-untyped-def]
    """The compiled part of `values_along_paths`."""
    value = np.zeros((len(cells), len(shares)))
    added = np.zeros(count, np.int64)  # the views of each cell along the path to the current goal, as bits
    touched = np.full(count, -1)
    for goal in range(len(cells)):
        on_the_way = 0.0
        for point in range(first[goal + 1] - 1, first[goal] - 1, -1):
            at = place[point]
            share = shares[heading[point]]
            on_the_way += _value(cells[at], views[at], seen[at], worth[at], share, added, touched, goal)
            for ray in range(len(share)):
                cell = cells[at, ray]
                if share[ray] > 0.0 and cell >= 0:
                    if touched[cell] != goal:
                        touched[cell], added[cell] = goal, 0
                    added[cell] |= views[at, ray]
        for ahead in range(len(shares)):
            there = _value(cells[goal], views[goal], seen[goal], worth[goal], shares[ahead], added, touched, goal)
            value[goal, ahead] = on_the_way + there
    return value


@compiled
def _value(cells, views, seen, worth, share, added, touched, goal):  # type: ignore[no-untyped-def]
    """The value of one view."""
    total = 0.0
    for ray in range(len(share)):
        cell = cells[ray]
        if share[ray] == 0.0 or cell < 0:
            continue
        known = seen[ray] | added[cell] if touched[cell] == goal else seen[ray]
        count, rest = 1.0, known
        while rest != 0:
            rest &= rest - 1
            count += 1.0
        total += share[ray] * worth[ray] / (count * count if known & views[ray] != 0 else count)
    return total
