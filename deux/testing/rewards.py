"""Conformance suite for rewards: tests of the contract of `deux.contracts.Reward`.

A plugin's test file subclasses it, and pytest runs the whole suite:

    class TestMyReward(RewardSuite):
        def make_reward(self) -> Reward:
            return MyReward()

The experiences are those of a robot that moves randomly through rooms of `deux.testing.box_world`. The map and the
policy's view are computed by `deux.environment.memory`, as in the environment.
"""

from collections.abc import Callable, Iterator, Sequence
from copy import deepcopy
from dataclasses import replace
from functools import lru_cache

import numpy as np

from deux.contracts import COLOR, Channel, Episode, Experience, Need, Observation, Reward
from deux.environment.egocentric import Crops
from deux.environment.memory import MOVES, ExplorationMemory
from deux.errors import kind_of
from deux.geometry.camera import Camera
from deux.testing.box_world import BoxWorld
from deux.testing.explorers import two_rooms

CAMERA = Camera(32, 32)

MakeWorld = Callable[[], BoxWorld]
"""Function that creates a world with the robot at the start of its walk."""


def rooms() -> BoxWorld:
    """Create two rooms with a doorway; the robot is in the left room."""
    known = two_rooms()
    world = BoxWorld(known.width, known.length, known.boxes, CAMERA)
    world.reset(1.5, 2.0, 0.0)
    return world


def hall() -> BoxWorld:
    """Create an empty hall."""
    return BoxWorld(4.0, 7.0, camera=CAMERA)


def shaft() -> BoxWorld:
    """Create a shaft slightly wider than the robot."""
    side = 2.0 * hall().robot.radius + 0.02
    return BoxWorld(side, side, camera=CAMERA)


def wander(
    make_world: MakeWorld, needs: frozenset[Need], steps: int, seed: int, depth: bool = True
) -> Iterator[Experience]:
    """Yield the experiences of a walk of random moves, most of them forward, including that before the first move.

    Args:
        make_world: function that creates the robot's world.
        needs: needs of the reward; observations only contain labels if they are needed.
        steps: number of moves.
        seed: seed of the moves.
        depth: whether depth images contain values; otherwise they are 0 everywhere.
    """
    for experience in _walk(make_world, steps, seed, depth):
        own = deepcopy(experience)
        yield own if Need.LABELS in needs else replace(own, observation=replace(own.observation, labels=None))


@lru_cache(maxsize=24)  # the tests of all rewards use the same few walks
def _walk(make_world: MakeWorld, steps: int, seed: int, depth: bool) -> tuple[Experience, ...]:
    rng = np.random.default_rng(seed)
    world, found = make_world(), []
    memory = ExplorationMemory(world.camera, world.robot, Crops(pixels=16))
    action, collided = None, False
    for step in range(steps + 1):
        frame = world.observe(COLOR | {Channel.LABELS})
        seen = frame.depth if depth else np.zeros_like(frame.depth)
        memory.see(seen, frame.pose, collided)
        known = memory.occupancy
        observation = Observation(step, frame.pose, collided, frame.rgb, seen, labels=frame.labels)
        grids = (known.cells.copy(), known.views.copy(), known.seen.copy())
        found.append(Experience(observation, action, known.frame, *grids, memory.view()))
        move = MOVES[rng.choice(len(MOVES), p=[0.6, 0.2, 0.2])]
        memory.acted(move)
        action, collided = int(move), world.step(move)
    return tuple(found)


def begin(reward: Reward, make_world: MakeWorld, steps: int, seed: int) -> None:
    """Reset a reward for an episode in a world, with only the data that it declares in `needs`."""
    world = make_world()
    names = world.label_names if Need.LABELS in reward.needs else ()
    reward.reset(Episode(seed, steps, world.camera, world.robot, label_names=names))


def rewards_of(reward: Reward, make_world: MakeWorld, steps: int, seed: int = 0, depth: bool = True) -> list[float]:
    """Reset a reward and return its values for all experiences of a walk; the arguments are those of `wander`."""
    begin(reward, make_world, steps, seed)
    return [value_of(reward, experience) for experience in wander(make_world, reward.needs, steps, seed, depth)]


def value_of(reward: Reward, experience: Experience) -> float:
    """Call a reward and check that its value is a float."""
    value: object = reward(experience)
    assert isinstance(value, float), f"the reward gives {kind_of(value)}, not a float"
    return value


def equal(first: Sequence[float], second: Sequence[float]) -> bool:
    """Whether values are equal; NaN equals NaN, since another test reports it."""
    return np.array_equal(first, second, equal_nan=True)


class RewardSuite:
    """Base class of the tests of a reward. Subclasses define `make_reward`."""

    steps = 30
    """Number of moves of an episode; increase it for a reward whose values only vary later."""

    def make_reward(self) -> Reward:
        """Create the reward to test."""
        raise NotImplementedError

    def test_needs_are_declared(self) -> None:
        """`needs` is an empty frozenset or contains `Need.LABELS`."""
        needs = self.make_reward().needs
        assert isinstance(needs, frozenset)
        assert needs <= {Need.LABELS}, f"a reward can ask for Need.LABELS and nothing else, not for {set(needs)}"

    def test_is_a_finite_number(self) -> None:
        """All values of an episode are finite floats, and not all of them are equal."""
        values = rewards_of(self.make_reward(), rooms, self.steps)
        assert np.isfinite(values).all(), f"not finite: {values}"
        assert len(set(values[1:])) > 1, "every step is worth the same: there is nothing to learn from"

    def test_same_experience_same_reward(self) -> None:
        """Two rewards return equal values for the same episodes."""
        first, second = self.make_reward(), self.make_reward()
        for seed in (1, 2):
            values = [rewards_of(reward, rooms, self.steps, seed) for reward in (first, second)]
            assert equal(*values), "the same episode gave different rewards: draw from episode.seed"

    def test_reset_forgets_everything(self) -> None:
        """After another episode, a reset reward equals a new one with the same state."""
        used, new = self.make_reward(), self.make_reward()
        rewards_of(used, hall, self.steps, seed=1)
        begin(used, rooms, self.steps, seed=0)
        new.load_state(used.state())
        begin(new, rooms, self.steps, seed=0)
        for experience in wander(rooms, used.needs, self.steps, seed=0):
            values = [value_of(reward, experience) for reward in (used, new)]
            assert equal(values[:1], values[1:]), "`reset` must forget everything but what `state` returns"

    def test_instances_share_nothing(self) -> None:
        """The values of a reward do not depend on another instance that is called alternately."""
        alone = rewards_of(self.make_reward(), rooms, self.steps)
        reward, other = self.make_reward(), self.make_reward()
        begin(reward, rooms, self.steps, seed=0)
        begin(other, hall, self.steps, seed=1)
        elsewhere = wander(hall, other.needs, self.steps, seed=1)
        together = []
        for experience, foreign in zip(wander(rooms, reward.needs, self.steps, seed=0), elsewhere, strict=True):
            other(foreign)
            together.append(value_of(reward, experience))
        assert equal(together, alone), "the rewards of two environments must have nothing in common"

    def test_leaves_the_experience_alone(self) -> None:
        """The reward does not write to the arrays of an experience, which belong to the environment."""
        reward = self.make_reward()
        begin(reward, rooms, self.steps, seed=0)
        for experience in wander(rooms, reward.needs, self.steps, seed=0):
            before = deepcopy(experience)
            reward(experience)
            for name, array in _arrays(experience).items():
                assert np.array_equal(array, _arrays(before)[name]), f"the reward changed {name}"

    def test_keeps_no_array_of_the_experience(self) -> None:
        """The reward copies the arrays that it stores, since the environment modifies them after the call."""
        expected = rewards_of(self.make_reward(), rooms, self.steps)
        reward = self.make_reward()
        begin(reward, rooms, self.steps, seed=0)
        values = []
        for experience in wander(rooms, reward.needs, self.steps, seed=0):
            own = deepcopy(experience)
            values.append(value_of(reward, own))
            for array in _arrays(own).values():
                array.fill(1)
        assert equal(values, expected), "the reward remembers arrays that the environment changes: copy them"

    def test_survives_empty_depth(self) -> None:
        """The values are finite when the depth is 0 everywhere, as in front of glass or too close to a wall."""
        values = rewards_of(self.make_reward(), rooms, self.steps, depth=False)
        assert np.isfinite(values).all(), f"not finite: {values}"

    def test_survives_standing_still(self) -> None:
        """The values are finite in a shaft slightly wider than the robot, in which nothing new is seen."""
        values = rewards_of(self.make_reward(), shaft, 2 * self.steps)
        assert np.isfinite(values).all(), f"not finite: {values}"

    def test_state_is_arrays_that_stay_as_they_are(self) -> None:
        """`state` returns arrays by name, which later episodes do not change."""
        reward = self.make_reward()
        for seed in (1, 2):
            rewards_of(reward, rooms, self.steps, seed)
        state = reward.state()
        for name, array in state.items():
            assert isinstance(name, str), f"the state's name {name!r} is not text"
            numeric = isinstance(array, np.ndarray) and array.dtype.kind in "biuf"
            assert numeric, f"the state {name!r} is {kind_of(array)}: checkpoints hold arrays of numbers"
        before = deepcopy(state)
        for seed in (2, 1):
            rewards_of(reward, rooms, self.steps, seed)
        for name, array in state.items():
            assert np.array_equal(array, before[name]), f"further training changed {name} in a state returned before"

    def test_state_round_trips(self) -> None:
        """A new reward with a loaded state returns the same state and the same values as the original."""
        used, new = self.make_reward(), self.make_reward()
        for seed in (1, 2):
            rewards_of(used, rooms, self.steps, seed)
        begin(used, rooms, self.steps, seed=0)
        state = used.state()
        new.load_state(deepcopy(state))
        assert new.state().keys() == state.keys()
        assert all(np.array_equal(new.state()[name], state[name]) for name in state), "the state is not what was loaded"
        same = equal(rewards_of(new, rooms, self.steps, seed=0), rewards_of(used, rooms, self.steps, seed=0))
        assert same, "a reward with a loaded state differs from the one whose state it is"


def _arrays(experience: Experience) -> dict[str, np.ndarray]:
    """All arrays of an experience, by name."""
    parts = {**vars(experience), **vars(experience.observation), **experience.view}
    return {name: part for name, part in parts.items() if isinstance(part, np.ndarray)}
