import numpy as np
import pytest

from deux.contracts import Reward
from deux.testing.rewards import RewardSuite, judge, rooms
from deux_plugins.rewards.curiosity import CuriosityReward


class TestCuriosityReward(RewardSuite):
    def make_reward(self) -> Reward:
        return CuriosityReward()


class TestCuriosityRewardThatDoesNotLearn(RewardSuite):
    def make_reward(self) -> Reward:
        return CuriosityReward(learn=False)


NOTHING = {"near": np.zeros((4, 8, 8), np.uint8), "far": np.zeros((4, 8, 8), np.uint8)}
"""A view whose features are all 0."""


def constant_model(learning_rate=1e-4, learn=True):
    """A reward with two features, whose forward model answers (3, 4) to everything."""
    reward = CuriosityReward(features=2, hidden=4, learning_rate=learning_rate, learn=learn)
    state = {name: np.zeros_like(value) for name, value in reward.state().items()}
    state[list(state)[-1]] = np.array([3.0, 4.0], np.float32)
    reward.load_state(state)
    return reward


def test_is_the_squared_error_of_the_forward_model_by_hand(make_experience, make_episode):
    reward = constant_model()
    reward.reset(make_episode())
    assert reward(make_experience(action=None, view=NOTHING)) == 0.0
    # (3, 4) was foreseen and (0, 0) came.
    assert reward(make_experience(action=1, view=NOTHING)) == pytest.approx(25.0)


def test_one_episode_moves_the_forward_model_by_one_step_of_adam_by_hand(make_experience, make_episode):
    reward = constant_model(learning_rate=0.5)
    for expected in (25.0, 2.5**2 + 3.5**2):  # Adam's first step is the learning rate, whatever the gradient is
        reward.reset(make_episode(steps=1))
        reward(make_experience(action=None, view=NOTHING))
        assert reward(make_experience(action=0, view=NOTHING)) == pytest.approx(expected, rel=1e-5)


def test_nothing_is_learnt_if_it_must_not(make_experience, make_episode):
    reward = constant_model(learning_rate=0.5, learn=False)
    for _ in range(3):
        reward.reset(make_episode(steps=1))
        reward(make_experience(action=None, view=NOTHING))
        assert reward(make_experience(action=0, view=NOTHING)) == 25.0


def test_an_episode_that_was_broken_off_teaches_nothing(make_experience, make_episode):
    """So that an environment that is reset with a seed, wherever it stood, does the same again."""
    reward = constant_model(learning_rate=0.5)
    for _ in range(3):
        reward.reset(make_episode(steps=2))
        reward(make_experience(action=None, view=NOTHING))
        assert reward(make_experience(action=0, view=NOTHING)) == 25.0


def test_features_are_a_projection_of_both_crops_in_eight_by_eight_blocks(make_experience, make_episode):
    """Against numpy: the model answers (3, 4), so the values of three views give the features away."""
    rng = np.random.default_rng(0)
    reward = constant_model()
    reward.reset(make_episode())

    def value_of(view):
        reward(make_experience(action=None, view=NOTHING))
        return reward(make_experience(action=0, view=view))

    near, far = (rng.integers(0, 256, (4, 16, 16)).astype(np.uint8) for _ in range(2))
    value = value_of({"near": near, "far": far})
    means = [block.reshape(4, 8, 2, 8, 2).mean(axis=(2, 4)).repeat(2, 1).repeat(2, 2) for block in (near, far)]
    shuffled = near.reshape(4, 8, 2, 8, 2)[:, :, ::-1, :, ::-1].reshape(4, 16, 16)
    assert value_of({"near": shuffled, "far": far}) == pytest.approx(value, rel=1e-5), "only a block's mean counts"
    assert value_of({"near": means[0], "far": means[1]}) == pytest.approx(value, rel=1e-5)
    assert value_of({"near": far, "far": near}) != pytest.approx(value, rel=1e-3), "near and far are told apart"
    assert value_of({"near": near[:, ::-1], "far": far}) != pytest.approx(value, rel=1e-3)


def test_what_is_seen_again_and_again_becomes_boring():
    reward = CuriosityReward(learning_rate=1e-3)
    sums = [sum(judge(reward, rooms, 30, seed=1)) for _ in range(12)]
    assert sums[0] > 0.0
    assert sums[-1] < 0.5 * sums[0]


def test_actions_are_part_of_what_is_foreseen(make_experience, make_episode):
    reward = CuriosityReward()
    reward.reset(make_episode())
    values = set()
    for action in range(3):
        reward(make_experience(action=None, view=NOTHING))
        values.add(reward(make_experience(action=action, view=NOTHING)))
    assert len(values) == 3
