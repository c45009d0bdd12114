"""Viewpoints: frames at free poses spread uniformly over a scene, chosen by no explorer.

Each is stored as a sequence of three frames, whose last is the target. The other two precede it on a short path of the
robot or, for ideal viewpoints, are the best pair of source frames among free poses around it.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path

import numpy as np

from deux.collection.episodes import MakeSimulator
from deux.collection.free_floor import write_free_floor
from deux.collection.jobs import Executor, Job, Plan, run_here, run_unfinished
from deux.collection.specification import place_name
from deux.contracts import COLOR, Action, Frame, Robot, SceneReference, Simulator
from deux.errors import DeuxError
from deux.geometry.grid import FreeSpace
from deux.geometry.source_frames import SourceRule, SourceView, choose_sources, has_parallax
from deux.geometry.stratify import stratify
from deux.io.frames import FrameWriter, prepare_folders
from deux.io.images import quantise_depth
from deux.io.layout import SequencePaths, frame_name
from deux.io.processes import Count
from deux.io.progress import Progress, ignore_progress

MOTIONS = (
    (Action.FORWARD, Action.FORWARD),
    (Action.LEFT, Action.FORWARD),
    (Action.RIGHT, Action.FORWARD),
    (Action.FORWARD, Action.LEFT),
    (Action.FORWARD, Action.RIGHT),
)
"""The pairs of actions that may lead to a viewpoint; each moves the camera, so that there is parallax."""

_ATTEMPTS = 50
"""Number of random poses that are tried in a viewpoint's own part of the floor, and then on the whole floor."""

_CANDIDATES = 12
"""Number of poses around an ideal viewpoint from which its two source frames are chosen."""

_FEW = 256
"""Fewer viewpoints than this in generated scenes are rendered in this process: starting others takes as long."""


@dataclass(frozen=True)
class ViewpointPlan(Plan):
    """A viewpoint to record, as a sequence of three frames.

    Args:
        folder: where its sequence is written.
        scene: the scene.
        seed: seed of the poses, the same for all viewpoints of the floor.
        index: number of the viewpoint on its floor.
        count: number of viewpoints on the floor.
        floor: the floor of the scene, an index into `Simulator.floors`.
        ideal: whether its source frames are ideal instead of on a path of the robot.
    """

    seed: int
    index: int
    count: int
    floor: int = 0
    ideal: bool = False

    @property
    def size(self) -> int:
        """One: progress counts viewpoints."""
        return 1

    @property
    def paths(self) -> SequencePaths:
        """The paths of the sequence's files."""
        return SequencePaths(self.folder)

    @property
    def finished(self) -> bool:
        """Whether all three frames are on disk."""
        return all(self.paths.file("absolute_pose", frame_name(number)).exists() for number in range(3))


def plan_viewpoints(
    data: Path, scene: SceneReference, seed: int, count: int, floor: int = 0, ideal: bool = False
) -> tuple[ViewpointPlan, ...]:
    """The viewpoints of one floor of a scene.

    Args:
        data: folder of all sequences.
        scene: the scene.
        seed: seed of the poses.
        count: number of viewpoints.
        floor: the floor of the scene, an index into `Simulator.floors`.
        ideal: whether their source frames are ideal.
    """
    place = place_name(scene, floor)
    return tuple(
        ViewpointPlan(data / f"{place}-view{index:04d}", scene, seed, index, count, floor, ideal)
        for index in range(count)
    )


@dataclass(frozen=True)
class ViewpointRunner:
    """Records the viewpoints of a job, floor by floor.

    Args:
        make_simulator: creates the simulator of a scene, once for each floor.
    """

    make_simulator: MakeSimulator

    def __call__(self, job: Job[ViewpointPlan], count: Count) -> None:
        """Render a job's viewpoints and write their files.

        Args:
            job: the viewpoints, grouped by floor.
            count: called for each viewpoint.

        Raises:
            DeuxError: a scene has no free floor, or no room for one step forward on it; or the disk is full.
        """
        for _, group in groupby(job.plans, key=lambda plan: (plan.scene, plan.floor)):
            plans = tuple(group)
            simulator = self.make_simulator(plans[0].scene)
            draw = _ideal_frames if plans[0].ideal else _frames
            parts = _parts(simulator, plans[0])
            with FrameWriter() as writer:
                for plan in plans:
                    frames = draw(simulator, plan, parts)
                    prepare_folders(plan.paths, simulator.camera.intrinsics, labels=False)
                    if plan.ideal and plan.index == 0:  # one of them stores the floor, for evaluation
                        write_free_floor(plan.folder, simulator.free_space(plan.floor))
                    for number, frame in enumerate(frames):
                        writer.put(plan.paths, number, frame)
                    count(1)


def collect_viewpoints(
    floors: Sequence[tuple[ViewpointPlan, ...]],
    make_simulator: MakeSimulator,
    execute: Executor = run_here,
    progress: Progress = ignore_progress,
) -> None:
    """Record each viewpoint as a sequence of three frames.

    Viewpoints on disk are not rendered again. Viewpoints that see too little are rejected later, by verification.

    Args:
        floors: the viewpoints of each floor, from `plan_viewpoints`.
        make_simulator: creates the simulator of a scene.
        execute: runs the jobs, one or more for each floor; not used for few viewpoints in generated scenes, which load
            fast. The frames do not depend on where they are rendered.
        progress: called with the number of viewpoints.

    Raises:
        DeuxError: a scene has no free floor, or no room for one step forward on it; or the disk is full.
    """
    jobs = [Job(plans, divisible=True) for plans in floors]
    waiting = [plan for plans in floors for plan in plans if not plan.finished]
    quick = len(waiting) < _FEW and all(plan.scene.file is None for plan in waiting)
    run = ViewpointRunner(make_simulator)
    run_unfinished("viewpoints", run, jobs, run_here if quick else execute, progress)


def _parts(simulator: Simulator, plan: ViewpointPlan) -> list[np.ndarray]:
    """The part of the floor, as cells, from which each viewpoint is drawn."""
    try:
        return stratify(simulator.free_space(plan.floor).free, plan.count)
    except DeuxError as error:
        raise DeuxError(f"Scene {plan.scene.name} has no viewpoints: {error}") from error


def _frames(simulator: Simulator, plan: ViewpointPlan, parts: list[np.ndarray]) -> list[Frame]:
    """Draw poses in the viewpoint's part of the floor until the robot can reach one of them by a motion."""
    rng = np.random.default_rng([plan.seed, plan.index])
    space = simulator.free_space(plan.floor)
    for cells in (parts[plan.index], np.concatenate(parts)):
        for _ in range(_ATTEMPTS):
            row, column = rng.choice(cells) + rng.uniform(-0.5, 0.5, size=2)
            x, z = space.frame.centre(row, column)
            yaw, motion = rng.uniform(-math.pi, math.pi), MOTIONS[rng.integers(len(MOTIONS))]
            way = poses_before(x, z, yaw, motion, simulator.robot)
            if all(_is_free(space, *place[:2]) for place in way):
                poses = _camera_poses(simulator, way[0], motion, plan.floor)
                if poses is not None:
                    seen = simulator.observe(COLOR, poses)
                    return [Frame(frame.rgb.copy(), quantise_depth(frame.depth), frame.pose.copy()) for frame in seen]
    raise DeuxError(
        f"Scene {plan.scene.name} has no viewpoints: the robot finds no room on floor {plan.floor} for one step "
        "forward."
    )


def _ideal_frames(simulator: Simulator, plan: ViewpointPlan, parts: list[np.ndarray]) -> list[Frame]:
    """Draw poses in the viewpoint's part of the floor until one has two good source frames among free poses around it.

    These satisfy `SourceRule`, with visibility by true depth, and have the highest scores.
    """
    rng, rule = np.random.default_rng([plan.seed, plan.index]), SourceRule()
    space, intrinsics = simulator.free_space(plan.floor), simulator.camera.intrinsics
    for cells in (parts[plan.index], np.concatenate(parts)):
        for _ in range(_ATTEMPTS):
            row, column = rng.choice(cells) + rng.uniform(-0.5, 0.5, size=2)
            x, z = space.frame.centre(row, column)
            target = (x, z, rng.uniform(-math.pi, math.pi))
            around = [pose for pose in _poses_around(target, rule, rng) if _is_free(space, *pose[:2])]
            if len(around) < 2 or not _is_free(space, x, z):
                continue
            poses = []
            for place in (target, *around):
                simulator.reset(*place, plan.floor)
                poses.append(simulator.pose)
            frames = [
                Frame(frame.rgb.copy(), quantise_depth(frame.depth), frame.pose.copy())
                for frame in simulator.observe(COLOR, np.stack(poses))
            ]
            views = [SourceView.of(frame.pose, intrinsics, frame.depth) for frame in frames]
            good = {k: view for k, view in enumerate(views) if k and has_parallax(views[0], [view], rule)}
            if len(good) >= 2:
                best, second = choose_sources(views[0], good, rule).steps
                return [frames[second], frames[best], frames[0]]
    raise DeuxError(
        f"Scene {plan.scene.name} has no ideal viewpoints: no two cameras on floor {plan.floor} see enough of what a "
        "third one sees."
    )


def _poses_around(
    target: tuple[float, float, float], rule: SourceRule, rng: np.random.Generator
) -> list[tuple[float, float, float]]:
    """Random poses (x, z, yaw) at the rule's distances from the target, turned by at most half its largest angle."""
    x, z, yaw = target
    distances = rng.uniform(rule.min_distance, rule.max_distance, _CANDIDATES)
    directions = rng.uniform(-math.pi, math.pi, _CANDIDATES)
    turns = np.radians(rng.uniform(-rule.max_angle / 2, rule.max_angle / 2, _CANDIDATES))
    return [
        (x + d * math.sin(a), z + d * math.cos(a), yaw + turn)
        for d, a, turn in zip(distances.tolist(), directions.tolist(), turns.tolist(), strict=True)
    ]


def poses_before(
    x: float, z: float, yaw: float, motion: Sequence[Action], robot: Robot
) -> list[tuple[float, float, float]]:
    """The poses (x, z, yaw) along `motion` that end at the given pose, first to last, including that one."""
    poses = [(x, z, yaw)]
    for action in reversed(motion):
        if action == Action.FORWARD:  # yaw 0 looks along -Z
            x, z = x + robot.forward_step * math.sin(yaw), z + robot.forward_step * math.cos(yaw)
        else:
            turn = math.radians(robot.turn_angle)
            yaw += -turn if action == Action.LEFT else turn
        poses.append((x, z, yaw))
    return poses[::-1]


def _is_free(space: FreeSpace, x: float, z: float) -> bool:
    rows, columns = space.frame.cells(x, z)
    return bool(space.frame.contains(rows, columns)) and bool(space.free[rows, columns])


def _camera_poses(
    simulator: Simulator, start: tuple[float, float, float], motion: Sequence[Action], floor: int
) -> np.ndarray | None:
    """The camera's poses along a motion, N x 4 x 4, or None if the robot collided."""
    simulator.reset(*start, floor)
    poses = [simulator.pose]
    for action in motion:
        if simulator.step(action):
            return None
        poses.append(simulator.pose)
    return np.stack(poses)
