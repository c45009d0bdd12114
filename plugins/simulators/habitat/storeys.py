"""The storeys of a building, their floors and free space, from the navmesh."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import ndimage

from deux.contracts import Floor, Robot
from deux.contracts.scene import SceneArea
from deux.errors import DeuxError
from deux.geometry.grid import FreeSpace, GridFrame
from deux_plugins.simulators.habitat.navmesh import NavmeshSamples, clearance

LEVEL = 0.1  # metres above and below a level within which the navmesh belongs to it
LEAST_AREA = 1.0  # square metres of a storey's level
STOREY = 2.0  # least distance in metres between two storeys
DOMINANT = 0.1  # a storey's least area, as a fraction of the largest one's
COVERED = 0.5  # of a storey lies under a ceiling, unless it is a roof
EVERYWHERE = np.ones((3, 3))  # cells that touch at a corner are connected

Survey = Callable[[GridFrame, float, float], np.ndarray]
"""Of a grid, a level and the headroom over it: a value for each cell, as `survey.ground` and `survey.covered`."""


@dataclass(frozen=True)
class Storey:
    """One floor that the robot can live on.

    Args:
        floor: its height and area.
        space: where the robot can be; its heights are those of the surface under the navmesh.
        navmesh: rows x columns float32: world y of the navmesh in each free cell, metres, NaN elsewhere.
    """

    floor: Floor
    space: FreeSpace
    navmesh: np.ndarray

    def navmesh_at(self, x: float, z: float) -> float | None:
        """World y of the navmesh in the free cell at world (x, z), metres; None where the cell is not free."""
        row, column = self.space.frame.cells(x, z)
        if not (self.space.frame.contains(row, column) and self.space.free[row, column]):
            return None
        return float(self.navmesh[row, column])

    def ground_at(self, x: float, z: float) -> float | None:
        """World y of the surface at world (x, z), metres, in a free cell or one beside it; None elsewhere."""
        row, column = self.space.frame.cells(x, z)
        if not (self.space.frame.contains(row, column) and self._near[row, column]):
            return None
        return float(self._ground_everywhere[row, column])

    @cached_property
    def _near(self) -> np.ndarray:
        """Rows x columns bool: free cells and those beside them, which the navmesh may cover in part."""
        near: np.ndarray = ndimage.binary_dilation(self.space.free, EVERYWHERE)
        return near

    @cached_property
    def _ground_everywhere(self) -> np.ndarray:
        """The free cells' heights, and elsewhere that of the nearest one."""
        rows, columns = ndimage.distance_transform_edt(~self.space.free, return_distances=False, return_indices=True)
        return self.space.heights[rows, columns]


def find_storeys(
    samples: NavmeshSamples, robot: Robot, area: SceneArea, ground: Survey, covered: Survey
) -> tuple[Storey, ...]:
    """Find the storeys of a building and their free floors.

    A storey is a height at which much of the navmesh lies, `STOREY` metres or more from every larger one. Stairs
    belong to the storey that is nearer in height, up to half way. Of a storey the largest connected part is taken, or
    the one that holds `area.start`. Where some storeys lie under a ceiling, those that do not are roofs and left out.

    The navmesh lies up to a cell's height above the surface that it was made from; heights are the surface's.

    Args:
        samples: the navmesh.
        robot: its body.
        area: the part of the scene that is asked for.
        ground: the surface that can be seen from above.
        covered: what lies under a ceiling.

    Returns:
        The storeys that `area.floor` asks for: the largest one first, then the others from the lowest to the highest.

    Raises:
        DeuxError: there is none, or not the one that is asked for.
    """
    levels = _levels(samples)
    if not levels:
        raise DeuxError(f"there is no floor to stand on: the navmesh has no level of {LEAST_AREA:.0f} m2.")
    nearest = np.abs(samples.heights[:, None] - np.array(levels)).argmin(axis=1)
    found: list[tuple[Storey, bool]] = []
    for number, level in enumerate(levels):
        of_level = samples.selected(nearest == number)
        part = _part(of_level, area)
        if part is not None:
            storey = _storey(of_level, part, level, robot, ground)
            under = covered(samples.frame, level, robot.height)[storey.space.free]
            found.append((storey, bool(under.mean() >= COVERED)))
    if not found:
        raise DeuxError(_nowhere(area))
    has_ceilings = any(inside for _, inside in found)
    storeys = sorted(
        (storey for storey, inside in found if inside or not has_ceilings), key=lambda storey: storey.floor.height
    )
    return _chosen(storeys, area)


def _levels(samples: NavmeshSamples) -> list[float]:
    """Heights at which much of the navmesh lies, metres, from the lowest up; no two closer than `STOREY`."""
    heights = np.sort(samples.heights)
    levels: list[float] = []
    least = LEAST_AREA
    while heights.size:
        within = np.searchsorted(heights, heights + LEVEL, side="right") - np.searchsorted(heights, heights - LEVEL)
        peak = int(within.argmax())
        area = within[peak] * samples.frame.resolution**2
        if area < least:
            break
        least = max(least, DOMINANT * area)
        levels.append(float(np.median(heights[np.abs(heights - heights[peak]) <= LEVEL])))
        heights = heights[np.abs(heights - levels[-1]) >= STOREY]
    return sorted(levels)


def _part(samples: NavmeshSamples, area: SceneArea) -> NavmeshSamples | None:
    """The connected part of a storey where the robot lives; None if it has none."""
    if area.region is not None:
        x = samples.frame.origin_x + (samples.columns + 0.5) * samples.frame.resolution
        z = samples.frame.origin_z + (samples.rows + 0.5) * samples.frame.resolution
        x_min, z_min, x_max, z_max = area.region
        samples = samples.selected((x >= x_min) & (z >= z_min) & (x <= x_max) & (z <= z_max))
    best: NavmeshSamples | None = None
    for island in np.unique(samples.islands):
        of_island = samples.selected(samples.islands == island)
        regions, _ = ndimage.label(np.isfinite(of_island.grid()), EVERYWHERE)
        part = regions[of_island.rows, of_island.columns]
        if area.start is not None:
            row, column = samples.frame.cells(*area.start)
            if samples.frame.contains(row, column) and regions[row, column]:
                return of_island.selected(part == regions[row, column])
            continue
        chosen = of_island.selected(part == np.bincount(part).argmax())
        if best is None or len(chosen.rows) > len(best.rows):
            best = chosen
    return best


def _storey(storey: NavmeshSamples, part: NavmeshSamples, level: float, robot: Robot, ground: Survey) -> Storey:
    frame = part.frame
    navmesh = part.grid()
    free = np.isfinite(navmesh)
    island = storey.selected(storey.islands == part.islands[0])
    seen = ground(frame, level, robot.height)
    known = free & np.isfinite(seen)
    lift = navmesh - seen
    usual = float(np.median(lift[known])) if known.any() else 0.0
    # Elsewhere something hides the ground from above, such as stairs that rise over the level's headroom.
    trusted = known & (np.abs(lift - usual) <= robot.max_climb + LEVEL)
    surface = np.where(trusted, seen, navmesh - usual).astype(np.float32)
    height = float(np.median(surface[free]))
    off_obstacles = clearance(np.isfinite(island.grid()), frame.resolution, robot.radius)
    space = FreeSpace(frame, free, off_obstacles, height, surface)
    return Storey(Floor(height, space.area), space, navmesh.astype(np.float32))


def _chosen(storeys: list[Storey], area: SceneArea) -> tuple[Storey, ...]:
    """Those of all storeys, from the lowest up, that `area.floor` asks for, the largest one first."""
    if isinstance(area.floor, int):
        if not 0 <= area.floor < len(storeys):
            there = ", ".join(f"{n} at {s.floor.height:.2f} m of {s.floor.area:.1f} m2" for n, s in enumerate(storeys))
            raise DeuxError(f"there is no floor {area.floor}: counted from the lowest there is {there}.")
        return (storeys[area.floor],)
    main = max(storeys, key=lambda storey: storey.floor.area)
    if area.floor == "largest":
        return (main,)
    return (main, *(storey for storey in storeys if storey is not main))


def _nowhere(area: SceneArea) -> str:
    within = "" if area.region is None else f" within the region {list(area.region)}"
    if area.start is not None:
        return f"the robot cannot stand at the start x={area.start[0]}, z={area.start[1]}{within}."
    return f"there is no floor to stand on{within}: the navmesh has nothing there."
