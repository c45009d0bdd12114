"""Exploration statistics of a dataset: actions, bumps and the explored area.

A place is one floor of a scene. All episodes of a place are drawn into one map, from the ground truth of all their
frames, including rejected ones. The map has cells of 0.1 m and a range of 3 m, see `deux.studies.exploration_meter`.
"""

from collections import defaultdict
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from deux.collection.free_floor import known_free_cells, read_free_floor
from deux.collection.specification import place_of_sequence
from deux.contracts import Action, Robot
from deux.environment.egocentric import Crops
from deux.environment.memory import ExplorationMemory
from deux.errors import DeuxError
from deux.geometry.camera import Camera
from deux.io.calibration import read_pose
from deux.io.images import read_depth
from deux.io.json_files import read_json_object
from deux.io.layout import SequencePaths, sequences

_BUMP_TOLERANCE = 1e-5
"""Difference of the squared forward step and the squared movement above which the step is a bump, square metres."""

_READ_AHEAD = 64
"""Number of depth maps that are read ahead."""


@dataclass(frozen=True)
class ExploredPlaces:
    """Exploration statistics of a dataset.

    Args:
        actions: number of actions in all episodes; None without episodes, as for free viewpoints.
        bumps: forward steps shortened by an obstacle, per 100 actions; None without episodes. The last action of an
            episode is not included, since no frame shows its result.
        area: square metres of the floor plan, free or occupied, that the frames show.
        floor_share: fraction of the free floor that the frames show, 0 to 1; None if the dataset does not include the
            free floor of each place.
        area_per_action: area divided by actions; None without actions.
    """

    actions: int | None
    bumps: float | None
    area: float
    floor_share: float | None
    area_per_action: float | None


def measure_explored_places(dataset: Path, camera: Camera, robot: Robot) -> ExploredPlaces:
    """Compute the exploration statistics of a collected dataset.

    Args:
        dataset: folder of the dataset.
        camera: camera of the robot.
        robot: body of the robot.

    Raises:
        DeuxError: a file is missing or damaged.
    """
    places: dict[str, list[SequencePaths]] = defaultdict(list)
    for sequence in sequences(dataset):
        places[place_of_sequence(sequence.name)].append(sequence)
    with ThreadPoolExecutor() as pool:  # decoding releases the interpreter's lock
        explored = [_explore(members, camera, robot, pool) for members in places.values()]
    area = sum(place.area for place in explored)
    actions = sum(place.actions for place in explored)
    free = [place.free_cells for place in explored]
    covered = sum(place.covered_cells for place in explored)
    return ExploredPlaces(
        actions=actions or None,
        bumps=100 * sum(place.bumps for place in explored) / actions if actions else None,
        area=area,
        floor_share=covered / sum(free) if free and all(free) else None,
        area_per_action=area / actions if actions else None,
    )


@dataclass(frozen=True)
class _Place:
    """Statistics of one place; the cells are those of its free floor, 0 if it is unknown."""

    actions: int
    bumps: int
    area: float
    free_cells: int
    covered_cells: int


def _explore(members: Iterable[SequencePaths], camera: Camera, robot: Robot, pool: ThreadPoolExecutor) -> _Place:
    """Draw all sequences of one place into one map."""
    memory = ExplorationMemory(camera, robot, Crops())
    count = bumps = 0
    floor = None
    for sequence in members:
        floor = floor or read_free_floor(sequence)
        actions = _actions(sequence)
        count += len(actions)
        names = sequence.frames()
        poses = [read_pose(sequence.file("absolute_pose", name)) for name in names]
        files = [sequence.file("ground_truth", name) for name in names]
        # In chunks, since all depth maps of a long sequence do not fit into memory.
        chunks = (files[first : first + _READ_AHEAD] for first in range(0, len(files), _READ_AHEAD))
        depths = (depth for chunk in chunks for depth in pool.map(read_depth, chunk))
        for number, (pose, depth) in enumerate(zip(poses, depths, strict=True)):
            before = actions[number - 1] if 0 < number <= len(actions) else None
            memory.acted(Action.STOP if before is None else before)  # a jump to another sequence is not an action
            bump = before is Action.FORWARD and _is_bump(poses[number - 1], pose, robot)
            memory.see(depth, pose, bump)
            bumps += bump
    free_cells = covered = 0
    if floor is not None:
        free_cells, covered = int(np.count_nonzero(floor[1])), known_free_cells(memory.occupancy, *floor)
    return _Place(count, bumps, memory.area, free_cells, covered)


def _actions(sequence: SequencePaths) -> list[Action]:
    """The explorer's action for each frame of an episode; empty for viewpoints, which have no episode."""
    record = sequence.folder / "episode.json"
    if not record.exists():
        return []
    try:
        return [Action(number) for number in read_json_object(record)["actions"]]
    except (DeuxError, ValueError, TypeError, KeyError) as error:
        raise DeuxError(f"{record} is damaged, it contains no episode ({error}): collect the dataset again.") from None


def _is_bump(before: np.ndarray, after: np.ndarray, robot: Robot) -> bool:
    """Whether the horizontal movement between two 4 x 4 camera poses is shorter than a forward step."""
    movement = after[[0, 2], 3] - before[[0, 2], 3]
    return bool(movement @ movement + _BUMP_TOLERANCE < robot.forward_step**2)
