from dataclasses import replace

import numpy as np
import pytest

from deux.contracts import Reward
from deux.geometry.poses import camera_pose
from deux.testing.rewards import RewardSuite, rewards_of, rooms
from deux_plugins.rewards.curiosity import CuriosityReward


class TestCuriosityReward(RewardSuite):
    def make_reward(self) -> Reward:
        return CuriosityReward()


class TestCuriosityRewardThatDoesNotLearn(RewardSuite):
    def make_reward(self) -> Reward:
        return CuriosityReward(learn=False)


def constant_model(learning_rate=1e-3, learn=True):
    """A reward with two features, whose forward model answers (3, 4) to everything."""
    reward = CuriosityReward(features=2, hidden=4, learning_rate=learning_rate, learn=learn)
    state = {name: np.zeros_like(value) for name, value in reward.state().items()}
    state[list(state)[-1]] = np.array([3.0, 4.0], np.float32)
    reward.load_state(state)
    return reward


def test_is_the_squared_error_of_the_forward_model_by_hand(make_experience, make_episode):
    reward = constant_model()
    reward.reset(make_episode())
    assert reward(make_experience(action=None)) == 0.0
    # (3, 4) was foreseen and (0, 0) came.
    assert reward(make_experience(action=1)) == pytest.approx(25.0)


def test_one_episode_moves_the_forward_model_by_one_step_of_adam_by_hand(make_experience, make_episode):
    reward = constant_model(learning_rate=0.5)
    for expected in (25.0, 2.5**2 + 3.5**2):  # Adam's first step is the learning rate, whatever the gradient is
        reward.reset(make_episode(steps=1))
        reward(make_experience(action=None))
        assert reward(make_experience(action=0)) == pytest.approx(expected, rel=1e-5)


def test_nothing_is_learnt_if_it_must_not(make_experience, make_episode):
    reward = constant_model(learning_rate=0.5, learn=False)
    for _ in range(3):
        reward.reset(make_episode(steps=1))
        reward(make_experience(action=None))
        assert reward(make_experience(action=0)) == 25.0


def test_an_episode_that_was_broken_off_teaches_nothing(make_experience, make_episode):
    """So that an environment that is reset with a seed, wherever it stood, does the same again."""
    reward = constant_model(learning_rate=0.5)
    for _ in range(3):
        reward.reset(make_episode(steps=2))
        reward(make_experience(action=None))
        assert reward(make_experience(action=0)) == 25.0


def test_features_are_of_the_map_around_the_robot_wherever_that_is_and_however_it_stands(make_experience, make_episode):
    reward = constant_model()
    reward.reset(make_episode())
    rng = np.random.default_rng(0)
    known = np.zeros((80, 80), np.int8)
    known[20:60, 20:60] = rng.integers(0, 3, (40, 40))

    def value_of(occupancy, x=4.0, z=4.0, yaw=0.0):
        """The model foresees (3, 4), so the value gives the features away."""
        reward(make_experience(action=None))
        seen = make_experience(x, z, occupancy=occupancy)
        turned = replace(seen.observation, pose=camera_pose(x, 1.25, z, yaw))
        return reward(replace(seen, observation=turned))

    value = value_of(known)
    assert value != pytest.approx(25.0, rel=1e-3)
    assert value_of(known, yaw=2.0) == pytest.approx(value), "turning on the spot is no surprise"
    assert value_of(np.roll(known, (10, 5), (0, 1)), 4.5, 5.0) == pytest.approx(value, rel=1e-5)
    assert value_of(known, x=4.5) != pytest.approx(value, rel=1e-3)
    exchanged = np.choose(known, [0, 2, 1]).astype(np.int8)
    assert value_of(exchanged) != pytest.approx(value, rel=1e-3), "free and occupied are told apart"


def test_a_new_reward_is_the_change_of_the_features(make_experience, make_episode):
    """Before it learned anything it foresees no change: known floor is worth nothing, however the robot turns."""
    reward = CuriosityReward()
    reward.reset(make_episode())
    floor = np.full((80, 80), 2, np.int8)
    assert reward(make_experience(4.0, 4.0, action=None, occupancy=floor)) == 0.0
    assert reward(make_experience(4.0, 4.0, action=1, occupancy=floor)) == 0.0
    less = floor.copy()
    less[:40] = 0
    assert reward(make_experience(4.0, 4.0, action=0, occupancy=less)) > 0.01


def test_what_is_seen_again_and_again_becomes_boring():
    reward = CuriosityReward(learning_rate=3e-3)
    sums = [sum(rewards_of(reward, rooms, 30, seed=1)) for _ in range(24)]
    assert sums[0] > 0.0
    assert sums[-1] < 0.5 * sums[0]


def test_actions_are_part_of_what_is_foreseen(make_experience, make_episode):
    reward = CuriosityReward()
    state = reward.state()
    state[list(state)[-2]] += 0.1  # a last layer that answers to what comes in
    reward.load_state(state)
    reward.reset(make_episode())
    values = set()
    for action in range(3):
        reward(make_experience(action=None))
        values.add(reward(make_experience(action=action)))
    assert len(values) == 3
