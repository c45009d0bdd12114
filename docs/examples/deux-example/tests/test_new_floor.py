import math

import numpy as np
import pytest

from deux.contracts import Experience, Observation, Reward
from deux.errors import DeuxError
from deux.geometry.grid import GridFrame
from deux.testing.rewards import RewardSuite
from deux_example.new_floor import NewFloorReward


class TestNewFloorReward(RewardSuite):
    def make_reward(self) -> Reward:
        return NewFloorReward()


def test_counts_only_new_free_cells_by_their_distance() -> None:
    frame = GridFrame(0.0, 0.0, 1, 4)
    pose = np.eye(4)
    pose[[0, 2], 3] = 0.5 * frame.resolution  # the middle of the first cell
    occupancy = np.array([[2, 2, 1, 2]], np.int8)  # the third is occupied
    views = np.array([[1, 2, 1, 1]], np.int32)  # the second was seen before
    observation = Observation(0, pose, False, np.zeros((1, 1, 3), np.uint8))
    experience = Experience(observation, None, frame, occupancy, views, np.ones((1, 4), bool), {})
    expected = (1.0 + math.exp(-3.0 * frame.resolution / 2.0)) * frame.resolution**2
    assert NewFloorReward(reach=2.0)(experience) == pytest.approx(expected)


def test_a_reach_that_is_not_positive_is_refused() -> None:
    with pytest.raises(DeuxError, match=r"reach is 0\.0: it must be above 0"):
        NewFloorReward(reach=0.0)
