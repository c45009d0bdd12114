"""The floors of a scene that its `SceneArea` selects, and the free space of each."""

import functools
import logging

from deux.contracts import Floor, Robot, Scene, SceneArea
from deux.errors import DeuxError
from deux.geometry.grid import FreeSpace
from deux.log_once import warn_once
from deux.mesh_files.mesh_extent import LARGEST, describe_size
from deux.scenes.floor import building_bounds
from deux.scenes.free_space import Box, FloorSurvey, survey_floor
from deux.scenes.ray_caster import RayCaster

REPORTED = 10.0  # square metres of excluded floor above which a warning is logged, or a tenth of the free space if less
LARGE = 2500.0  # square metres; in larger scenes only the building is mapped, if there is one

log = logging.getLogger(__name__)


class SceneFloors:
    """Selects the floors of a scene and computes their free space, once for each floor.

    If a floor has to be chosen among several, all of them are surveyed in the constructor; otherwise a floor is
    surveyed on first use. Warnings tell which floors there are and which parts the robot cannot reach.

    Args:
        scene: the scene.
        area: selects the floors, and a part of them.
        robot: the robot's body.
        caster: a ray caster of the scene's mesh.

    Raises:
        DeuxError: the scene is too high, there is no such floor, or the robot fits on none of the floors.
    """

    def __init__(self, scene: Scene, area: SceneArea, robot: Robot, caster: RayCaster) -> None:
        bounds = scene.mesh.bounds
        if bounds[1, 1] - bounds[0, 1] > LARGEST:  # the ground around a building may be longer
            raise DeuxError(
                f"{scene.name} is {describe_size(bounds)} large, but a scene must be at most {LARGEST:.0f} m high: is "
                "its mesh in metres?"
            )
        self._scene, self._area, self._robot, self._caster = scene, area, robot, caster
        self._surveys: dict[Floor, FloorSurvey] = {}
        self.floors = self._chosen()
        """The selected floors, the main one first."""
        self._warn_of_floors()

    def free_space(self, number: int) -> FreeSpace:
        """The free space of a floor in world positions, by the floor's index in `floors`; raises as `mesh_space`."""
        space, origin = self.mesh_space(number), self._scene.mesh.origin
        return space.moved(*origin) if any(origin) else space

    def mesh_space(self, number: int) -> FreeSpace:
        """The free space of a floor relative to the mesh's origin, by the floor's index in `floors`.

        Raises:
            DeuxError: there is no such floor, or the robot fits nowhere on it.
        """
        count = len(self.floors)
        if not 0 <= number < count:
            listed = " and ".join(_described(floor) for floor in self.floors)
            raise DeuxError(
                f"{self._scene.name} has no floor {number}: its floors are numbered 0 to {count - 1}, at {listed}."
            )
        survey = self._survey(self.floors[number])
        for level in survey.unreached:
            warn_once(
                log,
                f"{self._scene.name}: a level {abs(level.rise):.2f} m {'higher' if level.rise > 0 else 'lower'} of "
                f"{level.area:.0f} m2 cannot be reached: robot.max_climb is {self._robot.max_climb}.",
            )
        self._warn_of_excluded_floor(survey)
        return survey.space

    def _warn_of_excluded_floor(self, survey: FloorSurvey) -> None:
        """Warn if a large area of the same height is excluded from the free space."""
        free = survey.space.area
        beginning = f"{self._scene.name}: beside the {free:.0f} m2 of free space"
        if self._area.start is None and survey.apart > min(REPORTED, free / 10):
            warn_once(
                log,
                f"{beginning}, {survey.apart:.0f} m2 cannot be reached, such as behind closed doors or passages too "
                f"narrow for robot.radius={self._robot.radius}: choose another part by scenes.start=[x, z].",
            )
        if survey.outside > min(REPORTED, free / 10):
            warn_once(
                log,
                f"{beginning}, {survey.outside:.0f} m2 have no ceiling and are considered outdoors: include them by "
                "scenes.region=[x_min, z_min, x_max, z_max].",
            )

    def _chosen(self) -> tuple[Floor, ...]:
        every, asked = self._scene.floors, self._area.floor
        if isinstance(asked, int):
            if not 0 <= asked < len(every):
                raise DeuxError(
                    f"{self._scene.name} has no floor {asked}: its floors, from the lowest, are "
                    f"{self._listed()}; choose one with scenes.floor=0 to {len(every) - 1}, largest or all."
                )
            return (sorted(every, key=lambda floor: floor.height)[asked],)
        if len(every) == 1:
            return every
        areas = {floor: survey.space.area for floor in every if (survey := self._try_survey(floor)) is not None}
        if not areas:
            self._survey(every[0])  # raises the main floor's error
        return tuple(areas) if asked == "all" else (max(areas, key=lambda floor: areas[floor]),)

    def _warn_of_floors(self) -> None:
        """Log which floors there are and which of them are used, if there are several."""
        count = len(self._scene.floors)
        if count > 1:
            used = " and ".join(self._free_area(floor) for floor in self.floors)
            warn_once(
                log,
                f"{self._scene.name} has {count} floors, {self._listed()}: the robot explores the floor at {used} "
                f"(scenes.floor={self._area.floor}).",
            )

    def _free_area(self, floor: Floor) -> str:
        if floor not in self._surveys:
            return _described(floor)
        return f"{_described(floor)}, of which {self._surveys[floor].space.area:.0f} m2 are free"

    def _listed(self) -> str:
        """All floors of the scene in words, from the lowest to the highest."""
        ordered = sorted(self._scene.floors, key=lambda floor: floor.height)
        return ", ".join(f"{number} at {_described(floor)}" for number, floor in enumerate(ordered))

    def _try_survey(self, floor: Floor) -> FloorSurvey | None:
        try:
            return self._survey(floor)
        except DeuxError:
            return None

    def _survey(self, floor: Floor) -> FloorSurvey:
        if floor not in self._surveys:
            x, y, z = self._scene.mesh.origin
            others = [other.height - y for other in self._scene.floors if other != floor]
            region, start = self._area.region, self._area.start
            try:
                found = survey_floor(
                    self._scene.mesh,
                    floor.height - y,
                    self._robot,
                    caster=self._caster,
                    other_floors=others,
                    bounds=self._bounds,
                    region=region and (region[0] - x, region[1] - z, region[2] - x, region[3] - z),
                    start=start and (start[0] - x, start[1] - z),
                )
            except DeuxError as error:
                listed = f"; the floors of the scene are {self._listed()}." if others else "."
                raise DeuxError(f"{self._scene.name}: {str(error).removesuffix('.')}{listed}") from error
            self._surveys[floor] = found
        return self._surveys[floor]

    @functools.cached_property
    def _bounds(self) -> Box | None:
        """The bounding rectangle of the building if the scene is much larger than a building, otherwise None."""
        low, high = self._scene.mesh.bounds.astype(float)[:, [0, 2]]
        if self._area.region is not None or self._area.start is not None or (high - low).prod() <= LARGE:
            return None
        return building_bounds(self._scene.mesh, self._caster)


def _described(floor: Floor) -> str:
    return f"{round(floor.height, 2) + 0.0:.2f} m ({floor.area:.0f} m2)"  # + 0.0 avoids "-0.00"
