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

import numpy as np

from deux.contracts import Episode, Experience, Need, Observation, Reward
from deux.environment.egocentric import Crops
from deux.environment.memory import MOVES, ExplorationMemory
from deux.testing.box_world import BoxWorld
from deux.testing.explorers import two_rooms

Change = Callable[[Observation], Observation]
"""What a test does to what the robot sees."""


def wander(
    world: BoxWorld, needs: frozenset[Need], steps: int, seed: int, change: Change = lambda seen: seen
) -> Iterator[Experience]:
    """A walk of random moves, more of them forward than not, and what each look brings; the first look included.

    Args:
        world: the robot's world; the robot starts where it stands.
        needs: what the observations carry besides the depth.
        steps: number of moves.
        seed: of the moves.
        change: applied to each observation before it is mapped.
    """
    rng = np.random.default_rng(seed)
    memory = ExplorationMemory(world.camera, world.robot, Crops(pixels=16))
    action, collided = None, False
    for step in range(steps + 1):
        frame = world.observe(labels=True)
        labels = frame.labels if Need.LABELS in needs else None
        seen = change(Observation(step, frame.pose, collided, frame.rgb, frame.depth, labels=labels))
        assert seen.sensor_depth is not None
        memory.see(seen.sensor_depth, frame.pose, collided)
        known = memory.occupancy
        yield Experience(
            seen, action, known.frame, known.cells.copy(), known.views.copy(), known.seen.copy(), memory.view()
        )
        move = MOVES[rng.choice(len(MOVES), p=[0.6, 0.2, 0.2])]
        memory.acted(move)
        action, collided = int(move), world.step(move)


def begin(reward: Reward, world: BoxWorld, steps: int, seed: int) -> None:
    """Reset a reward for an episode in a world; it is told what it declared in `needs`, and nothing else."""
    names = world.label_names if Need.LABELS in reward.needs else ()
    reward.reset(Episode(seed, steps, world.camera, world.robot, label_names=names))


def judge(
    reward: Reward, world: BoxWorld, steps: int, seed: int = 0, change: Change = lambda seen: seen
) -> list[float]:
    """Reset a reward and return what it gives for each look of a walk."""
    begin(reward, world, steps, seed)
    return [reward(experience) for experience in wander(world, reward.needs, steps, seed, change)]


class RewardSuite:
    """Tests of one reward. Subclass it and give `make_reward`; see this module's docstring."""

    steps = 40
    """Moves of an episode; raise it for a reward that takes longer to show itself."""

    def make_reward(self) -> Reward:
        """A new reward, with the options that are to be tested."""
        raise NotImplementedError

    def test_needs_are_declared(self) -> None:
        """`needs` is a frozenset that holds `Need.LABELS` or nothing."""
        needs = self.make_reward().needs
        assert isinstance(needs, frozenset)
        assert needs <= {Need.LABELS}, f"a reward can ask for Need.LABELS and nothing else, not for {set(needs)}"

    def test_is_a_finite_number(self) -> None:
        """Each look of an episode is worth a finite float, and not all of them the same."""
        values = judge(self.make_reward(), two_rooms(), self.steps)
        assert all(isinstance(value, float) for value in values), f"not floats: {[type(v) for v in values]}"
        assert np.isfinite(values).all(), f"not finite: {values}"
        assert len(set(values[1:])) > 1, "every step is worth the same: there is nothing to learn from"

    def test_same_experience_same_reward(self) -> None:
        """Two rewards that see the same episodes give the same values."""
        first, second = self.make_reward(), self.make_reward()
        for seed in (3, 7):
            values = [judge(reward, two_rooms(), self.steps, seed) for reward in (first, second)]
            assert values[0] == values[1], "the same episode gave different rewards: draw from episode.seed"

    def test_reset_forgets_everything(self) -> None:
        """After another episode, `reset` leaves nothing but what `state` returns."""
        used, new = self.make_reward(), self.make_reward()
        judge(used, BoxWorld(4.0, 7.0), self.steps, seed=3)
        begin(used, two_rooms(), self.steps, seed=7)
        new.load_state(used.state())
        begin(new, two_rooms(), self.steps, seed=7)
        for experience in wander(two_rooms(), used.needs, self.steps, seed=7):
            assert used(experience) == new(experience), "`reset` must forget everything but what `state` returns"

    def test_instances_share_nothing(self) -> None:
        """Another environment's reward changes nothing, even in the middle of an episode."""
        alone = judge(self.make_reward(), two_rooms(), self.steps)
        reward, other = self.make_reward(), self.make_reward()
        begin(reward, two_rooms(), self.steps, seed=0)
        begin(other, BoxWorld(4.0, 7.0), self.steps, seed=1)
        elsewhere = wander(BoxWorld(4.0, 7.0), other.needs, self.steps, seed=1)
        together = []
        for experience, foreign in zip(wander(two_rooms(), reward.needs, self.steps, seed=0), elsewhere, strict=True):
            other(foreign)
            together.append(reward(experience))
        assert together == alone, "the rewards of two environments must have nothing in common"

    def test_leaves_the_experience_alone(self) -> None:
        """The arrays belong to the environment: a reward must not write to them."""
        reward = self.make_reward()
        begin(reward, two_rooms(), self.steps, seed=0)
        for experience in wander(two_rooms(), reward.needs, self.steps, seed=0):
            before = deepcopy(experience)
            reward(experience)
            for name, array in _arrays(experience).items():
                assert np.array_equal(array, _arrays(before)[name]), f"the reward changed {name}"

    def test_keeps_no_array_of_the_experience(self) -> None:
        """The environment writes to its arrays after the call: what a reward remembers must be a copy."""
        expected = judge(self.make_reward(), two_rooms(), self.steps)
        reward = self.make_reward()
        begin(reward, two_rooms(), self.steps, seed=0)
        values = []
        for experience in wander(two_rooms(), reward.needs, self.steps, seed=0):
            own = deepcopy(experience)
            values.append(reward(own))
            for array in _arrays(own).values():
                array.fill(1)
        assert values == expected, "the reward remembers arrays that the environment changes: copy them"

    def test_survives_empty_depth(self) -> None:
        """The depth may be 0 everywhere: a camera before glass, or too close to a wall."""

        def empty(seen: Observation) -> Observation:
            assert seen.sensor_depth is not None
            return replace(seen, sensor_depth=np.zeros_like(seen.sensor_depth))

        assert np.isfinite(judge(self.make_reward(), two_rooms(), self.steps, change=empty)).all()

    def test_survives_standing_still(self) -> None:
        """A shaft barely wider than the robot, where nothing new is to be seen."""
        side = 2.0 * two_rooms().robot.radius + 0.02
        assert np.isfinite(judge(self.make_reward(), BoxWorld(side, side), 2 * self.steps)).all()

    def test_state_is_arrays_that_stay_as_they_are(self) -> None:
        """`state` returns arrays by name, which further training does not change."""
        reward = self.make_reward()
        for seed in (1, 2):
            judge(reward, two_rooms(), self.steps, seed)
        state = reward.state()
        assert all(isinstance(name, str) and isinstance(array, np.ndarray) for name, array in state.items())
        before = deepcopy(state)
        for seed in (3, 4):
            judge(reward, two_rooms(), self.steps, seed)
        for name, array in state.items():
            assert np.array_equal(array, before[name]), f"further training changed {name} in a state returned before"

    def test_state_round_trips(self) -> None:
        """A new reward that takes up a state returns the same state, and judges alike."""
        used, new = self.make_reward(), self.make_reward()
        for seed in (1, 2):
            judge(used, two_rooms(), self.steps, seed)
        begin(used, two_rooms(), self.steps, seed=5)
        state = used.state()
        new.load_state(deepcopy(state))
        assert new.state().keys() == state.keys()
        assert all(np.array_equal(new.state()[name], state[name]) for name in state), "the state is not what was loaded"
        assert judge(new, two_rooms(), self.steps, seed=9) == judge(used, two_rooms(), self.steps, seed=9)


def _arrays(experience: Experience) -> dict[str, np.ndarray]:
    """All arrays of an experience, by name."""
    parts = {**vars(experience), **vars(experience.observation), **experience.view}
    return {name: part for name, part in parts.items() if isinstance(part, np.ndarray)}
