import numpy as np
import pytest

from deux.contracts import Action, Episode, Explorer, Observation, Robot
from deux.geometry.camera import Camera
from deux.testing.explorers import ExplorerSuite
from deux_example.wall_follower import WallFollower


class TestWallFollower(ExplorerSuite):
    def make_explorer(self) -> Explorer:
        return WallFollower()


@pytest.mark.parametrize(("ahead", "action"), [(0.5, Action.LEFT), (3.0, Action.FORWARD)])
def test_turns_away_from_a_wall_ahead_only_when_it_is_near(ahead: float, action: Action) -> None:
    explorer = WallFollower(distance=0.75)
    explorer.reset(Episode(seed=0, steps=1, camera=Camera(width=9, height=9), robot=Robot()))
    depth = np.full((9, 9), ahead, np.float32)
    image = np.zeros((9, 9, 3), np.uint8)
    assert explorer.act(Observation(0, np.eye(4), False, image, sensor_depth=depth)) is action
