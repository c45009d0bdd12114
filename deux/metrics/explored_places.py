"""What the robots of a dataset did and saw of its scenes: bumps, actions, and the area of the places they explored.

A place is one floor of a scene. All episodes of a place are drawn into one map, by the true depth of all their frames,
rejected ones included: cells of 0.1 m, seen from 3 m at most, as in `deux.studies.exploration_meter`.
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

_CUT_SHORT = 1e-5
"""Square metres by which the square of the way must fall short of the square of a step forward to be a bump."""

_SHARE = 64
"""Depth maps that are read ahead of being drawn."""


@dataclass(frozen=True)
class ExploredPlaces:
    """The places that a dataset's frames show.

    Args:
        actions: of all episodes; None where no robot acted, as with free viewpoints.
        bumps: steps forward that an obstacle cut short, for each 100 actions; None as above. What became of the last
            action of an episode no frame tells.
        area: square metres of floor plan, free or occupied, that the frames tell of.
        floor_share: fraction of the floor on which the robot's centre could be that the frames show as free, 0 to 1;
            None where a place's free floor is not kept with the dataset.
        area_per_action: area divided by actions; None without actions.
    """

    actions: int | None
    bumps: float | None
    area: float
    floor_share: float | None
    area_per_action: float | None


def measure_explored_places(dataset: Path, camera: Camera, robot: Robot) -> ExploredPlaces:
    """Measure what a collected dataset's robots did and saw.

    Args:
        dataset: its folder.
        camera: the robots' camera.
        robot: their body.

    Raises:
        DeuxError: a file is missing or damaged.
    """
    places: dict[str, list[SequencePaths]] = defaultdict(list)
    for sequence in sequences(dataset):
        places[place_of_sequence(sequence.name)].append(sequence)
    with ThreadPoolExecutor() as pool:  # decoding releases the interpreter's lock
        found = [_explore(members, camera, robot, pool) for members in places.values()]
    area = sum(one.area for one in found)
    actions = sum(one.actions for one in found)
    free = [one.free_cells for one in found]
    covered = sum(one.covered_cells for one in found)
    return ExploredPlaces(
        actions=actions or None,
        bumps=100 * sum(one.bumps for one in found) / actions if actions else None,
        area=area,
        floor_share=covered / sum(free) if free and all(free) else None,
        area_per_action=area / actions if actions else None,
    )


@dataclass(frozen=True)
class _Place:
    """What was done and seen in one place; the cells are those of its free floor, 0 where that is not known."""

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
        # In shares: all depth maps of a long sequence, read faster than they are drawn, would not fit into memory.
        shares = (files[first : first + _SHARE] for first in range(0, len(files), _SHARE))
        depths = (depth for share in shares for depth in pool.map(read_depth, share))
        for number, (pose, depth) in enumerate(zip(poses, depths, strict=True)):
            before = actions[number - 1] if 0 < number <= len(actions) else None
            memory.acted(Action.STOP if before is None else before)  # a jump to another sequence is no action
            bump = before is Action.FORWARD and _cut_short(poses[number - 1], pose, robot)
            memory.see(depth, pose, bump)
            bumps += bump
    free_cells = covered = 0
    if floor is not None:
        free_cells, covered = int(np.count_nonzero(floor[1])), known_free_cells(memory.occupancy, *floor)
    return _Place(count, bumps, memory.area, free_cells, covered)


def _actions(sequence: SequencePaths) -> list[Action]:
    """The answers of the explorer to each frame of an episode; none of a viewpoint, which is no episode."""
    record = sequence.folder / "episode.json"
    if not record.exists():
        return []
    try:
        return [Action(number) for number in read_json_object(record)["actions"]]
    except (DeuxError, ValueError, TypeError, KeyError) as error:
        raise DeuxError(f"{record} is damaged, it holds no episode ({error}): collect the dataset again.") from None


def _cut_short(before: np.ndarray, after: np.ndarray, robot: Robot) -> bool:
    """Whether a step forward from one camera pose, 4 x 4, to the next was cut short, by the way along the floor."""
    way = after[[0, 2], 3] - before[[0, 2], 3]
    return bool(way @ way + _CUT_SHORT < robot.forward_step**2)
