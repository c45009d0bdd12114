"""Rollouts of explorers in simulators: several episodes in lock-step, as an iterator of their steps.

Collection, comparison of explorers and study of uncertainty are loops over `run_walks`. Nothing is written here.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from deux.collection.perception import MODEL_NEEDS, SOURCES, HostPercept, Percept, Perception, on_host
from deux.contracts import COLOR, Action, Channel, Episode, Explorer, Frame, Need, Observation, Simulator
from deux.errors import DeuxError, shown
from deux.frame_uncertainty import check_not_negative
from deux.io.images import quantise_depth
from deux.registry import registry
from deux.simulator.starts import random_starts

StoredFrames = Callable[[int, np.ndarray], Frame | None]
"""Looks up a frame of an earlier run, by number and camera pose; returns None if it must be rendered."""


class Walk:
    """One episode of one explorer.

    Args:
        simulator: the simulator; the robot is placed at the start.
        explorer: the explorer; it is reset.
        seed: seed of the start and of the explorer.
        steps: number of actions; the last one is not executed, as no frame would follow it.
        floor: the floor on which it takes place, an index into `Simulator.floors`.
        stored: frames of an earlier run, which are not rendered again; or None. Simulator and explorer still take every
            step, so that their random state is the same as in an uninterrupted run.
    """

    def __init__(
        self,
        simulator: Simulator,
        explorer: Explorer,
        seed: int,
        steps: int,
        floor: int = 0,
        stored: StoredFrames | None = None,
    ) -> None:
        self.simulator = simulator
        self.explorer = explorer
        self.steps = steps
        self.actions: list[Action] = []
        """The actions chosen so far."""
        self.frames: tuple[Frame, ...] = ()
        """The latest frames, newest first, at most 1 + `SOURCES`."""
        self._stored = stored
        self._rendered = False
        self._collided = False
        free_space = simulator.free_space(floor)
        self.start = random_starts(free_space, 1, np.random.default_rng(seed))[0]
        """The start: world x and z in metres, and the heading in radians."""
        simulator.reset(*self.start, floor)
        shown = free_space if Need.FREE_SPACE in explorer.needs else None
        names = simulator.label_names if Need.LABELS in explorer.needs else ()
        explorer.reset(Episode(seed, steps, simulator.camera, simulator.robot, shown, names, floor))

    @property
    def over(self) -> bool:
        """Whether the last action has been chosen."""
        return len(self.actions) == self.steps or self.actions[-1:] == [Action.STOP]

    def observe(self) -> None:
        """Record the next frame, in arrays of its own, with depth quantised as in a dataset's files.

        Raises:
            DeuxError: the simulator's frame has the wrong size or types.
        """
        frame = self._stored(len(self.actions), self.simulator.pose) if self._stored else None
        self._rendered = frame is None
        if frame is None:
            channels = COLOR | {Channel.LABELS} if Need.LABELS in self.explorer.needs else COLOR
            seen = self.simulator.observe(channels)
            frame = Frame(seen.rgb.copy(), quantise_depth(seen.depth), seen.pose.copy(), seen.labels)
        self.frames = (frame, *self.frames[:SOURCES])

    def act(self, percept: Percept | None = None, seen: HostPercept | None = None) -> "Step":
        """Let the explorer choose an action for the newest frame, and execute it.

        Args:
            percept: the depth model's output for that frame; None without a model.
            seen: the parts of it that the explorer needs, in arrays of its own.

        Raises:
            DeuxError: the explorer did not return an action.
        """
        number, collided = len(self.actions), self._collided
        action = _action(self.explorer, number, self.explorer.act(self._observation(seen or HostPercept())))
        self.actions.append(action)
        if not self.over:
            self._collided = self.simulator.step(action)
        return Step(self, number, self.frames, self._rendered, collided, percept, action)

    def _observation(self, seen: HostPercept) -> Observation:
        """The observation with exactly what the explorer declared in `needs`, in arrays of its own."""
        needs, frame = self.explorer.needs, self.frames[0]
        needs_residual = Need.RESIDUAL in needs
        return Observation(
            step=len(self.actions),
            pose=frame.pose.copy(),
            collided=self._collided,
            rgb=frame.rgb.copy(),
            sensor_depth=frame.depth.copy() if Need.SENSOR_DEPTH in needs else None,
            predicted_depth=seen.predicted_depth if Need.PREDICTED_DEPTH in needs else None,
            residual=seen.residual if needs_residual else None,
            uncertainty=seen.uncertainty if needs_residual else None,
            depth_error=seen.depth_error if Need.PREDICTED_DEPTH in needs else None,
            labels=frame.labels.copy() if frame.labels is not None else None,
        )


@dataclass(frozen=True)
class Step:
    """One step of a walk: a frame, and the action that the explorer chose for it.

    Args:
        walk: the walk.
        number: number of the step, from 0.
        frames: the frame and those before it, newest first, at most 1 + `SOURCES`; their arrays are never modified.
        rendered: whether the frame was rendered, and not read from an earlier run.
        collided: whether an obstacle stopped the action before this frame early.
        percept: the depth model's output for the frame; None without a model.
        action: the explorer's choice, which is executed unless it is the walk's last one.
    """

    walk: Walk
    number: int
    frames: tuple[Frame, ...]
    rendered: bool
    collided: bool
    percept: Percept | None
    action: Action

    @property
    def frame(self) -> Frame:
        """The frame of this step."""
        return self.frames[0]


def run_walks(walks: Sequence[Walk], perception: Perception | None = None) -> Iterator[list[Step]]:
    """Run walks in lock-step: all observe, the depth model is called once, all act.

    Args:
        walks: new walks, of robots with the same camera.
        perception: the depth model; None for explorers that need none.

    Yields:
        The next step of each walk that is not over, until all are.

    Raises:
        DeuxError: an explorer needs more than `perception` provides, or an uncertainty measure returns negative values.
    """
    for walk in walks:
        check_perception(walk.explorer, perception)
    memories = {} if perception is None else {walk: perception.memory() for walk in walks}
    while active := [walk for walk in walks if not walk.over]:
        for walk in active:
            walk.observe()
        percepts: Sequence[Percept | None] = [None] * len(active)
        seen: Sequence[HostPercept | None] = [None] * len(active)
        if perception is not None:
            histories, intrinsics = [walk.frames for walk in active], active[0].simulator.camera.intrinsics
            found = perception(histories, intrinsics, [memories[walk] for walk in active])
            needs = frozenset[Need]().union(*(walk.explorer.needs for walk in active))
            percepts, seen = found, on_host(found, needs)
            for one in seen:
                if perception.uncertainty is not None and one.residual is not None:
                    check_not_negative(perception.uncertainty, one.residual)
        yield [walk.act(*given) for walk, given in zip(active, zip(percepts, seen, strict=True), strict=True)]


def check_perception(explorer: Explorer, perception: Perception | None) -> None:
    """Raise DeuxError if the explorer needs a depth model or an uncertainty measure that `perception` lacks."""
    needs = explorer.needs & MODEL_NEEDS
    if needs and perception is None:
        raise DeuxError(
            f"The explorer needs {' and '.join(sorted(needs))} but there is no depth model: train one first or name a "
            "checkpoint with seed_model.checkpoint."
        )
    if Need.RESIDUAL in needs and perception is not None and perception.uncertainty is None:
        raise DeuxError(
            f"The explorer needs {Need.RESIDUAL} but there is no measure of uncertainty: choose one with "
            "collect.uncertainty."
        )


def _action(explorer: Explorer, number: int, chosen: object) -> Action:
    """An explorer's choice as an action; its number is accepted as well."""
    if isinstance(chosen, int | np.integer) and not isinstance(chosen, bool) and chosen in list(Action):
        return Action(int(chosen))
    raise DeuxError(
        f"{registry().called(explorer)} chose {shown(chosen)} at step {number}: `act` returns a "
        f"deux.contracts.Action, one of {', '.join(action.name for action in Action)}."
    )
