"""The conformance suite of rewards: what every `deux.contracts.Reward` must do.

A plugin's test file subclasses it, and pytest runs the whole suite:

    class TestMyReward(RewardSuite):
        def make_reward(self) -> Reward:
            return MyReward()

The experiences are those of a robot that wanders through the rooms of `deux.testing.box_world`; the map and the
policy's view are the environment's own (`deux.environment.memory`).
"""

from collections.abc import Callable, Iterator
from copy import deepcopy
from dataclasses import replace
from functools import lru_cache

import numpy as np

from deux.contracts import COLOR, Channel, Episode, Experience, Need, Observation, Reward
from deux.environment.egocentric import Crops
from deux.environment.memory import MOVES, ExplorationMemory
from deux.geometry.camera import Camera
from deux.testing.box_world import BoxWorld
from deux.testing.explorers import two_rooms

CAMERA = Camera(32, 32)

MakeWorld = Callable[[], BoxWorld]
"""Makes a world with the robot where its walk begins."""


def rooms() -> BoxWorld:
    """Two rooms with a doorway between them; the robot in the left one."""
    known = two_rooms()
    world = BoxWorld(known.width, known.length, known.boxes, CAMERA)
    world.reset(1.5, 2.0, 0.0)
    return world


def hall() -> BoxWorld:
    """An empty hall."""
    return BoxWorld(4.0, 7.0, camera=CAMERA)


def shaft() -> BoxWorld:
    """A shaft barely wider than the robot."""
    side = 2.0 * hall().robot.radius + 0.02
    return BoxWorld(side, side, camera=CAMERA)


def wander(
    make_world: MakeWorld, needs: frozenset[Need], steps: int, seed: int, depth: bool = True
) -> Iterator[Experience]:
    """A walk of random moves, more of them forward than not, and what each look brings; the first look included.

    Args:
        make_world: makes the robot's world.
        needs: what the observations carry besides the depth.
        steps: number of moves.
        seed: of the moves.
        depth: whether the depth images show anything.
    """
    for experience in _walk(make_world, steps, seed, depth):
        own = deepcopy(experience)
        yield own if Need.LABELS in needs else replace(own, observation=replace(own.observation, labels=None))


@lru_cache(maxsize=24)  # the tests of all rewards take the same few walks
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
    """Reset a reward for an episode in a world, with exactly the data that it declares in `needs`."""
    world = make_world()
    names = world.label_names if Need.LABELS in reward.needs else ()
    reward.reset(Episode(seed, steps, world.camera, world.robot, label_names=names))


def judge(reward: Reward, make_world: MakeWorld, steps: int, seed: int = 0, depth: bool = True) -> list[float]:
    """Reset a reward and return what it gives for each look of a walk."""
    begin(reward, make_world, steps, seed)
    return [reward(experience) for experience in wander(make_world, reward.needs, steps, seed, depth)]


class RewardSuite:
    """Tests of one reward. Subclass it and give `make_reward`; see this module's docstring."""

    steps = 30
    """Moves of an episode; raise it for a reward that takes longer to show itself."""

    def make_reward(self) -> Reward:
        """A new reward, with the options that are to be tested."""
        raise NotImplementedError

    def test_needs_are_declared(self) -> None:
        """`needs` is an empty frozenset or contains `Need.LABELS`."""
        needs = self.make_reward().needs
        assert isinstance(needs, frozenset)
        assert needs <= {Need.LABELS}, f"a reward can ask for Need.LABELS and nothing else, not for {set(needs)}"

    def test_is_a_finite_number(self) -> None:
        """Each look of an episode is worth a finite float, and not all of them the same."""
        values = judge(self.make_reward(), rooms, self.steps)
        assert all(isinstance(value, float) for value in values), f"not floats: {[type(v) for v in values]}"
        assert np.isfinite(values).all(), f"not finite: {values}"
        assert len(set(values[1:])) > 1, "every step is worth the same: there is nothing to learn from"

    def test_same_experience_same_reward(self) -> None:
        """Two rewards that see the same episodes give the same values."""
        first, second = self.make_reward(), self.make_reward()
        for seed in (1, 2):
            values = [judge(reward, rooms, self.steps, seed) for reward in (first, second)]
            assert values[0] == values[1], "the same episode gave different rewards: draw from episode.seed"

    def test_reset_forgets_everything(self) -> None:
        """After another episode, `reset` leaves nothing but what `state` returns."""
        used, new = self.make_reward(), self.make_reward()
        judge(used, hall, self.steps, seed=1)
        begin(used, rooms, self.steps, seed=0)
        new.load_state(used.state())
        begin(new, rooms, self.steps, seed=0)
        for experience in wander(rooms, used.needs, self.steps, seed=0):
            assert used(experience) == new(experience), "`reset` must forget everything but what `state` returns"

    def test_instances_share_nothing(self) -> None:
        """Another environment's reward changes nothing, even in the middle of an episode."""
        alone = judge(self.make_reward(), rooms, self.steps)
        reward, other = self.make_reward(), self.make_reward()
        begin(reward, rooms, self.steps, seed=0)
        begin(other, hall, self.steps, seed=1)
        elsewhere = wander(hall, other.needs, self.steps, seed=1)
        together = []
        for experience, foreign in zip(wander(rooms, reward.needs, self.steps, seed=0), elsewhere, strict=True):
            other(foreign)
            together.append(reward(experience))
        assert together == alone, "the rewards of two environments must have nothing in common"

    def test_leaves_the_experience_alone(self) -> None:
        """The arrays belong to the environment: a reward must not write to them."""
        reward = self.make_reward()
        begin(reward, rooms, self.steps, seed=0)
        for experience in wander(rooms, reward.needs, self.steps, seed=0):
            before = deepcopy(experience)
            reward(experience)
            for name, array in _arrays(experience).items():
                assert np.array_equal(array, _arrays(before)[name]), f"the reward changed {name}"

    def test_keeps_no_array_of_the_experience(self) -> None:
        """The environment writes to its arrays after the call: what a reward remembers must be a copy."""
        expected = judge(self.make_reward(), rooms, self.steps)
        reward = self.make_reward()
        begin(reward, rooms, self.steps, seed=0)
        values = []
        for experience in wander(rooms, reward.needs, self.steps, seed=0):
            own = deepcopy(experience)
            values.append(reward(own))
            for array in _arrays(own).values():
                array.fill(1)
        assert values == expected, "the reward remembers arrays that the environment changes: copy them"

    def test_survives_empty_depth(self) -> None:
        """The depth may be 0 everywhere: a camera before glass, or too close to a wall."""
        assert np.isfinite(judge(self.make_reward(), rooms, self.steps, depth=False)).all()

    def test_survives_standing_still(self) -> None:
        """A shaft barely wider than the robot, where nothing new is to be seen."""
        assert np.isfinite(judge(self.make_reward(), shaft, 2 * self.steps)).all()

    def test_state_is_arrays_that_stay_as_they_are(self) -> None:
        """`state` returns arrays by name, which further training does not change."""
        reward = self.make_reward()
        for seed in (1, 2):
            judge(reward, rooms, self.steps, seed)
        state = reward.state()
        assert all(isinstance(name, str) and isinstance(array, np.ndarray) for name, array in state.items())
        before = deepcopy(state)
        for seed in (2, 1):
            judge(reward, rooms, self.steps, seed)
        for name, array in state.items():
            assert np.array_equal(array, before[name]), f"further training changed {name} in a state returned before"

    def test_state_round_trips(self) -> None:
        """A new reward that takes up a state returns the same state, and judges alike."""
        used, new = self.make_reward(), self.make_reward()
        for seed in (1, 2):
            judge(used, rooms, self.steps, seed)
        begin(used, rooms, self.steps, seed=0)
        state = used.state()
        new.load_state(deepcopy(state))
        assert new.state().keys() == state.keys()
        assert all(np.array_equal(new.state()[name], state[name]) for name in state), "the state is not what was loaded"
        assert judge(new, rooms, self.steps, seed=0) == judge(used, rooms, self.steps, seed=0)


def _arrays(experience: Experience) -> dict[str, np.ndarray]:
    """All arrays of an experience, by name."""
    parts = {**vars(experience), **vars(experience.observation), **experience.view}
    return {name: part for name, part in parts.items() if isinstance(part, np.ndarray)}
