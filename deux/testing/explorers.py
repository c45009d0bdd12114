"""Conformance suite for explorers: subclass it to test an explorer with pytest.

    from deux.testing.explorers import ExplorerSuite

    class TestMine(ExplorerSuite):
        def make_explorer(self):
            return Mine()

The worlds are rooms with boxes and exact depth (`deux.testing.box_world`), without a renderer or a depth model: the
predicted depth is the true depth, and the residual depends on the labels (`observe`).
"""

import math
from abc import abstractmethod
from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import zip_longest

import numpy as np

from deux.collection.explored_map import map_of
from deux.collection.specification import fingerprint_of
from deux.contracts import COLOR, Action, Channel, Episode, Explorer, Need, Observation, Simulator
from deux.geometry.camera import Camera
from deux.testing.box_world import Box, BoxWorld

Change = Callable[[Observation], Observation]
"""Function that changes an observation before the explorer gets it."""


def unchanged(observation: Observation) -> Observation:
    """Return the observation unchanged."""
    return observation


def observe(world: Simulator, needs: frozenset[Need], step: int, collided: bool) -> Observation:
    """Create the observation of an explorer, with only the data that it needs.

    The residual is 0.1 on boxes and 0.02 elsewhere. It is NaN for the first two frames, as in the collector.
    """
    frame = world.observe(COLOR | {Channel.LABELS})
    assert frame.labels is not None
    residual = np.where(frame.labels == 1, np.float32(0.1), np.float32(0.02))
    if step < 2:
        residual = np.full_like(residual, np.nan)
    return Observation(
        step=step,
        pose=frame.pose,
        collided=collided,
        rgb=frame.rgb,
        sensor_depth=frame.depth if Need.SENSOR_DEPTH in needs else None,
        predicted_depth=frame.depth.copy() if Need.PREDICTED_DEPTH in needs else None,
        residual=residual if Need.RESIDUAL in needs else None,
        uncertainty=1.0 - float(np.exp(-residual.mean())) if Need.RESIDUAL in needs else None,
        depth_error=0.0 if Need.PREDICTED_DEPTH in needs else None,
        labels=frame.labels if Need.LABELS in needs else None,
    )


def run(
    explorer: Explorer,
    world: Simulator,
    steps: int,
    seed: int = 0,
    change: Change = unchanged,
    until: Callable[[Observation], bool] | None = None,
) -> list[Action]:
    """Run an explorer for one episode from the robot's current pose, as in collection.

    Args:
        explorer: the explorer, which is reset first.
        world: the world; its robot remains at the last pose.
        steps: maximum number of actions.
        seed: seed of the episode.
        change: function that is applied to each observation.
        until: condition on an observation that ends the episode.

    Returns:
        The actions, including `Action.STOP` if the explorer stopped.
    """
    return list(actions_of(explorer, world, steps, seed, change, until))


def actions_of(
    explorer: Explorer,
    world: Simulator,
    steps: int,
    seed: int = 0,
    change: Change = unchanged,
    until: Callable[[Observation], bool] | None = None,
) -> Iterator[Action]:
    """Yield the actions of an episode one by one; the arguments are those of `run`."""
    free_space = world.free_space() if Need.FREE_SPACE in explorer.needs else None
    if free_space is not None:  # explorers must not write to these arrays, by which the robot moves
        free_space.free.flags.writeable = free_space.clearance.flags.writeable = False
    names = world.label_names if Need.LABELS in explorer.needs else ()
    explorer.reset(Episode(seed, steps, world.camera, world.robot, free_space, names))
    collided = False
    for step in range(steps):
        observation = change(observe(world, explorer.needs, step, collided))
        if until is not None and until(observation):
            return
        action = explorer.act(observation)
        yield action
        if action == Action.STOP:
            return
        collided = world.step(Action(action))


def pocket() -> BoxWorld:
    """A dead end, 0.3 m wide and 0.9 m deep, with the robot at its end, facing the wall."""
    walls = (Box(1.75, 0.0, 1.85, 0.9), Box(2.15, 0.0, 2.25, 0.9))
    world = BoxWorld(4.0, 4.0, walls, Camera(32, 32))
    world.reset(2.0, 0.15, 0.0)
    return world


def corner_with_leg() -> BoxWorld:
    """The corner of a room behind a table leg, with the robot facing the corner."""
    world = BoxWorld(4.0, 4.0, (Box(0.42, 0.42, 0.48, 0.48, 0.7),), Camera(32, 32))
    world.reset(0.14, 0.14, math.pi / 4.0)
    return world


def pen() -> BoxWorld:
    """A fence of 0.5 m height around a floor of 0.5 m size, with a gap of 0.3 m; the robot can see over it."""
    fence = (
        Box(1.75, 1.65, 2.25, 1.75, 0.5), Box(1.75, 2.25, 2.25, 2.35, 0.5), Box(1.65, 1.65, 1.75, 2.35, 0.5),
        Box(2.25, 1.65, 2.35, 1.85, 0.5), Box(2.25, 2.15, 2.35, 2.35, 0.5),
    )  # fmt: skip
    world = BoxWorld(4.0, 4.0, fence, Camera(32, 32))
    world.reset(2.0, 2.0, math.pi / 2.0)
    return world


TRAPS = {pocket: 1.0, corner_with_leg: 1.0, pen: 0.5}
"""Worlds in which robots get stuck, and the distance in metres from the start at which a robot has escaped."""


def two_rooms(camera: Camera | None = None) -> BoxWorld:
    """Two rooms of 3 x 4 m with a doorway of 1 m and a low box in each room; the robot is in the left room."""
    walls = (Box(2.95, 0.0, 3.05, 1.5), Box(2.95, 2.5, 3.05, 4.0))
    world = BoxWorld(6.0, 4.0, (*walls, Box(0.5, 0.5, 1.0, 1.0, 0.8), Box(4.5, 2.8, 5.5, 3.4, 0.5)), camera)
    world.reset(1.5, 2.0, 0.0)
    return world


class ExplorerSuite:
    """Base class of the tests of an explorer. Subclasses define `make_explorer`."""

    steps = 60
    """Number of steps of an episode in most tests."""

    escape_steps = 250
    """Maximum number of actions to escape from a trap."""

    most_pushes = 75
    """Maximum number of actions of an escape that push against an obstacle without moving the robot."""

    @abstractmethod
    def make_explorer(self) -> Explorer:
        """Create the explorer to test."""

    def run_legally(self, world: BoxWorld, steps: int, change: Change = unchanged) -> list[Action]:
        """Run a new explorer and check that it only returns valid actions."""
        actions = run(self.make_explorer(), world, steps, change=change)
        assert actions, "the explorer did not act"
        assert all(isinstance(action, Action) for action in actions), f"not Action values: {actions}"
        return actions

    def test_needs_are_declared(self) -> None:
        """`needs` is a frozenset of `Need` after construction."""
        needs = self.make_explorer().needs
        assert isinstance(needs, frozenset)
        assert all(isinstance(need, Need) for need in needs), f"not Need values: {needs}"

    def test_acts_legally(self) -> None:
        """All actions are of type `Action`, with observations that only contain the declared data."""
        self.run_legally(two_rooms(), self.steps)

    def test_same_seed_same_actions(self) -> None:
        """Two explorers with the same seed choose the same actions."""
        assert run(self.make_explorer(), two_rooms(), self.steps, seed=7) == run(
            self.make_explorer(), two_rooms(), self.steps, seed=7
        ), "the same seed gave different actions: draw all randomness from a generator seeded by episode.seed"

    def test_reset_forgets_everything(self) -> None:
        """After an episode in another world, `reset` restores the state of a new explorer."""
        used = self.make_explorer()
        elsewhere = BoxWorld(4.0, 7.0)
        run(used, elsewhere, self.steps, seed=3)
        assert run(used, two_rooms(), self.steps, seed=7) == run(
            self.make_explorer(), two_rooms(), self.steps, seed=7
        ), "a used explorer acted differently from a new one: `reset` must forget everything"

    def test_instances_share_nothing(self) -> None:
        """The actions of an explorer do not depend on another instance that explores another world at the same time."""
        alone = run(self.make_explorer(), two_rooms(), self.steps, seed=7)
        here = actions_of(self.make_explorer(), two_rooms(), self.steps, seed=7)
        elsewhere = actions_of(self.make_explorer(), BoxWorld(4.0, 7.0), self.steps, seed=3)
        together = [action for action, _ in zip_longest(here, elsewhere) if action is not None]
        assert together == alone, (
            "another explorer at work changed the actions: draw from a generator of the instance, not from a global "
            "one, and keep state in the instance, not in its class"
        )

    def test_takes_images_that_are_not_square(self) -> None:
        """The explorer acts with cameras whose images are wider than high, and higher than wide."""
        for camera in (Camera(48, 32), Camera(32, 48)):
            self.run_legally(two_rooms(camera), 20)

    def test_equal_explorers_have_one_fingerprint(self) -> None:
        """`fingerprint` is text or None, and equal for explorers with equal options, so that datasets are found."""
        first, second = self.make_explorer(), self.make_explorer()  # both exist, so their addresses differ
        assert fingerprint_of(first) == fingerprint_of(second), (
            "explorers with equal options have different fingerprints: no dataset would be reused"
        )

    def test_leaves_the_observation_alone(self) -> None:
        """The explorer does not write to the arrays of an observation, which the collector also uses."""

        def read_only(observation: Observation) -> Observation:
            for value in vars(observation).values():
                if isinstance(value, np.ndarray):
                    value.flags.writeable = False
            return observation

        self.run_legally(two_rooms(), 20, read_only)

    def test_survives_missing_residuals(self) -> None:
        """The explorer acts when the residual is NaN in all pixels or half of them for a whole episode."""

        def all_missing(observation: Observation) -> Observation:
            if observation.residual is None:
                return observation
            nothing = np.full_like(observation.residual, np.nan)
            return replace(observation, residual=nothing, uncertainty=float("nan"))

        def half_missing(observation: Observation) -> Observation:
            if observation.residual is None:
                return observation
            residual = observation.residual.copy()
            residual[:, ::2] = np.nan
            return replace(observation, residual=residual)

        self.run_legally(two_rooms(), self.steps, all_missing)
        self.run_legally(two_rooms(), self.steps, half_missing)

    def test_survives_empty_depth(self) -> None:
        """The explorer acts when the depth is 0 everywhere, as in front of glass or too close to a wall."""

        def empty(observation: Observation) -> Observation:
            def zeros(depth: np.ndarray | None) -> np.ndarray | None:
                return None if depth is None else np.zeros_like(depth)

            return replace(
                observation,
                sensor_depth=zeros(observation.sensor_depth),
                predicted_depth=zeros(observation.predicted_depth),
            )

        self.run_legally(two_rooms(), self.steps, empty)

    def test_survives_a_scene_of_one_cell(self) -> None:
        """The explorer acts in a shaft slightly wider than the robot, in which it can only turn."""
        side = 2.0 * two_rooms().robot.radius + 0.02
        self.run_legally(BoxWorld(side, side), self.steps)

    def test_survives_being_walled_in(self) -> None:
        """The explorer acts between low boxes on all sides, with a visible room that it cannot reach."""
        fence = (
            Box(1.5, 1.5, 2.5, 1.6, 0.5), Box(1.5, 2.4, 2.5, 2.5, 0.5),
            Box(1.5, 1.5, 1.6, 2.5, 0.5), Box(2.4, 1.5, 2.5, 2.5, 0.5),
        )  # fmt: skip
        self.run_legally(BoxWorld(4.0, 4.0, fence), self.steps)

    def test_survives_a_cell_of_its_own(self) -> None:
        """The explorer acts between walls of full height on all sides."""
        walls = (
            Box(1.5, 1.5, 2.5, 1.8), Box(1.5, 2.2, 2.5, 2.5),
            Box(1.5, 1.8, 1.8, 2.2), Box(2.2, 1.8, 2.5, 2.2),
        )  # fmt: skip
        self.run_legally(BoxWorld(4.0, 4.0, walls), self.steps)

    def test_survives_a_map_without_frontiers(self) -> None:
        """The explorer acts in a small room when no frontier remains."""
        self.run_legally(BoxWorld(1.5, 1.5), 2 * self.steps)

    def test_gets_out_of_traps(self) -> None:
        """The robot escapes from each of `TRAPS`, with at most `most_pushes` actions that push against obstacles.

        The explorer may also stop, which ends the episode. `deux.mapping.recovery.Recovery` frees a robot.
        """
        for trap, outside in TRAPS.items():
            world = trap()
            path = [world.pose[[0, 2], 3]]

            def is_out(observation: Observation, path: list[np.ndarray] = path, outside: float = outside) -> bool:
                path.append(observation.pose[[0, 2], 3])
                return bool(np.hypot(*(path[-1] - path[0])) > outside)

            actions = run(self.make_explorer(), world, self.escape_steps, until=is_out)
            moved = np.hypot(*np.diff(path[1:], axis=0).T) > 0.25 * world.robot.forward_step
            pushes = sum(action is Action.FORWARD and not far for action, far in zip(actions, moved, strict=False))
            where = f"in {trap.__name__}, {pushes} of {len(actions)} actions pushed the robot against an obstacle"
            remedy = "deux.mapping.recovery.Recovery frees a robot that is stuck, and Action.STOP ends the episode"
            assert pushes <= self.most_pushes, f"{where}, and at most {self.most_pushes} may (`most_pushes`): {remedy}"
            out = len(actions) < self.escape_steps or actions[-1] is Action.STOP
            limit = f"{self.escape_steps} actions (`escape_steps`)"
            assert out, f"{where}, and it did not get out within {limit}: {remedy}"

    def test_map_is_consistent(self) -> None:
        """`map` is None or contains grids of its frame's shape with valid types and values."""
        explorer = self.make_explorer()
        run(explorer, two_rooms(), self.steps)
        known = map_of(explorer)
        if known is None:
            return
        values = set(np.unique(known.occupancy).tolist())
        assert values <= {0, 1, 2}, f"occupancy is 0 (unknown), 1 (occupied) or 2 (free), but has {values}"
        if known.uncertainty is not None:
            recorded = known.uncertainty[~np.isnan(known.uncertainty)]
            assert ((recorded >= 0.0) & (recorded <= 1.0)).all(), "uncertainty is in [0, 1], or NaN for no value"

    def test_map_changes_nothing(self) -> None:
        """Calling `map` after every action changes neither the actions nor the map at the end."""
        asked, left_alone = self.make_explorer(), self.make_explorer()
        actions = []
        for action in actions_of(asked, two_rooms(), self.steps, seed=7):
            asked.map()
            actions.append(action)
        assert actions == run(left_alone, two_rooms(), self.steps, seed=7), "calling `map` changed later actions"
        found, expected = map_of(asked), map_of(left_alone)
        assert (found is None) == (expected is None), "calling `map` during the episode made it appear or vanish"
        if found is not None and expected is not None:
            assert (found.frame, found.target) == (expected.frame, expected.target), "calling `map` changed its frame"
            for name in ("occupancy", "uncertainty"):
                np.testing.assert_array_equal(getattr(found, name), getattr(expected, name), f"`map` changed {name}")
