"""The floors of a scene on which a robot lives, as its `SceneArea` chooses them, and the free space of each."""

import functools
import logging

from deux.contracts import Floor, Robot, Scene, SceneArea
from deux.errors import DeuxError
from deux.geometry.grid import FreeSpace
from deux.scenes.floor import building_bounds
from deux.scenes.free_space import Box, FloorSurvey, survey_floor
from deux.scenes.ray_caster import RayCaster

TOLD = 10.0  # square metres of floor that is left out of which the log tells, or a tenth of the room that is left
LARGE = 2500.0  # square metres; of larger scenes only the building is mapped, if there is one

log = logging.getLogger(__name__)


class SceneFloors:
    """Chooses the floors and finds their free space, each once.

    A mesh that is far from the world's origin has an origin of its own, from which bodies and rays count.

    Where one floor has to be chosen among several, all of them are surveyed at once; otherwise a floor is surveyed when
    it is asked for. The log says which floors there are and what the robot cannot reach.

    Args:
        scene: with all its floors.
        area: which of them the robot lives on, and where.
        robot: its body.
        caster: rays against the scene's mesh.

    Raises:
        DeuxError: there is no such floor, or the robot fits nowhere on those that there are.
    """

    def __init__(self, scene: Scene, area: SceneArea, robot: Robot, caster: RayCaster) -> None:
        self._scene, self._area, self._robot, self._caster = scene, area, robot, caster
        self._surveys: dict[Floor, FloorSurvey] = {}
        self.floors = self._chosen()
        """The floors on which the robot lives, the main one first."""
        self._say_taken()

    def free_space(self, number: int) -> FreeSpace:
        """The free space of a floor, by its number among `floors`; raises as `mesh_space`."""
        space, origin = self.mesh_space(number), self._scene.mesh.origin
        return space.moved(*origin) if any(origin) else space

    def mesh_space(self, number: int) -> FreeSpace:
        """The free space of a floor as seen from the mesh's origin.

        Raises:
            DeuxError: there is no such floor, or the robot fits nowhere on it.
        """
        count = len(self.floors)
        if not 0 <= number < count:
            listed = " and ".join(_described(floor) for floor in self.floors)
            raise DeuxError(
                f"{self._scene.name} has no floor {number}: its floors are numbered 0 to {count - 1}, at {listed}."
            )
        found = self._survey(self.floors[number])
        for level in found.unreached:
            _say_once(
                f"{self._scene.name}: a level {abs(level.rise):.2f} m {'higher' if level.rise > 0 else 'lower'} of "
                f"{level.area:.0f} m2 cannot be reached: robot.max_climb is {self._robot.max_climb}."
            )
        self._say_left_out(found)
        return found.space

    def _say_left_out(self, found: FloorSurvey) -> None:
        """Log how much floor is left out though it is of the same height."""
        room = found.space.area
        told = f"{self._scene.name}: beside the {room:.0f} m2 where the robot lives"
        if self._area.start is None and found.apart > min(TOLD, room / 10):
            _say_once(
                f"{told}, {found.apart:.0f} m2 cannot be reached, such as behind closed doors or passages too narrow "
                f"for robot.radius={self._robot.radius}: scenes.start=[x, z] takes another part."
            )
        if found.outside > min(TOLD, room / 10):
            _say_once(
                f"{told}, {found.outside:.0f} m2 have no ceiling and are taken for outside: "
                "scenes.region=[x_min, z_min, x_max, z_max] takes all that is within it."
            )

    def _chosen(self) -> tuple[Floor, ...]:
        every, asked = self._scene.floors, self._area.floor
        if isinstance(asked, int):
            if not 0 <= asked < len(every):
                raise DeuxError(
                    f"{self._scene.name} has no floor {asked}: counted from the lowest its floors are "
                    f"{self._listed()}; choose one with scenes.floor=0 to {len(every) - 1}, largest or all."
                )
            return (sorted(every, key=lambda floor: floor.height)[asked],)
        if len(every) == 1:
            return every
        room = {floor: found.space.area for floor in every if (found := self._try_survey(floor)) is not None}
        if not room:
            # The main floor's reason stands for the others'.
            self._survey(every[0])
        return tuple(room) if asked == "all" else (max(room, key=lambda floor: room[floor]),)

    def _say_taken(self) -> None:
        """Log which floors there are and on which of them the robot lives, if there are several."""
        count = len(self._scene.floors)
        if count > 1:
            lives = " and ".join(self._room(floor) for floor in self.floors)
            _say_once(
                f"{self._scene.name} has {count} floors, {self._listed()}: the robot lives at {lives} "
                f"(scenes.floor={self._area.floor})."
            )

    def _room(self, floor: Floor) -> str:
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
        """The rectangle around the building where the scene is much larger than a building."""
        low, high = self._scene.mesh.bounds.astype(float)[:, [0, 2]]
        if self._area.region is not None or self._area.start is not None or (high - low).prod() <= LARGE:
            return None
        return building_bounds(self._scene.mesh, self._caster)


def _described(floor: Floor) -> str:
    return f"{round(floor.height, 2) + 0.0:.2f} m ({floor.area:.0f} m2)"  # + 0.0: no minus before a zero


@functools.cache
def _say_once(sentence: str) -> None:
    """Log a sentence, once in each process: an episode's simulator is not the first one of its scene."""
    log.warning(sentence)
