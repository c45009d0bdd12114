"""The suite must pass a sound reward and catch each fault that it is there to catch."""

import numpy as np
import pytest

from deux.contracts import Need, Reward
from deux.testing.rewards import RewardSuite


class Sound(Reward):
    """The metres that the robot moved, and a count of episodes that it learns."""

    def __init__(self):
        self.episodes = np.zeros(1)
        self.before = None

    def reset(self, episode):
        self.rng = np.random.default_rng(episode.seed)
        self.before = None

    def __call__(self, experience):
        here = experience.observation.pose[[0, 2], 3].copy()
        moved = 0.0 if self.before is None else float(np.hypot(*(here - self.before)))
        self.before = here
        return moved + float(self.rng.uniform()) + float(self.episodes[0])

    def state(self):
        return {"episodes": self.episodes.copy()}

    def load_state(self, state):
        self.episodes = np.array(state["episodes"])


class Learns(Sound):
    def reset(self, episode):
        if self.before is not None:
            self.episodes += 1.0
        super().reset(episode)


class AsksForTheResidual(Sound):
    needs = frozenset({Need.RESIDUAL})


class DividesByZero(Sound):
    def __call__(self, experience):
        with np.errstate(divide="ignore", invalid="ignore"):
            return float(np.float64(1.0) / experience.observation.sensor_depth.mean())


class ReturnsAnArray(Sound):
    def __call__(self, experience):
        return np.array(super().__call__(experience))


class IsConstant(Sound):
    def __call__(self, experience):
        return 1.0


class IsUnseeded(Sound):
    def reset(self, episode):
        super().reset(episode)
        self.rng = np.random.default_rng()


class Remembers(Sound):
    before_all = None

    def __call__(self, experience):
        self.before_all = self.before_all if self.before_all is not None else experience.observation.pose[0, 3]
        return super().__call__(experience) + float(self.before_all)


class SharesItsCount(Sound):
    count: list = []  # noqa: RUF012

    def reset(self, episode):
        super().reset(episode)
        self.count.clear()

    def __call__(self, experience):
        self.count.append(1)
        return super().__call__(experience) + len(self.count)


class WritesToTheMap(Sound):
    def __call__(self, experience):
        experience.occupancy[:] = 1
        return super().__call__(experience)


class KeepsTheMap(Sound):
    known = None

    def reset(self, episode):
        super().reset(episode)
        self.known = None

    def __call__(self, experience):
        before, self.known = self.known, experience.occupancy
        return super().__call__(experience) + (0.0 if before is None else float(before.sum()))


class WorksOnlyInRooms(Sound):
    def __call__(self, experience):
        return float(np.log(np.count_nonzero(experience.occupancy) - 100.0))


class ReturnsItsOwnArray(Learns):
    def state(self):
        return {"episodes": self.episodes}


class ReturnsObjects(Learns):
    def state(self):
        return {**super().state(), "model": np.array([{"weights": 1.0}], dtype=object)}


class IsNaN(Sound):
    def __call__(self, experience):
        return float("nan")


class DoesNotLoad(Learns):
    def load_state(self, state):
        pass


def failures(reward_class):
    """Names of the suite's tests that fail for a reward."""

    class Suite(RewardSuite):
        steps = 12

        def make_reward(self):
            return reward_class()

    failed = set()
    for name in dir(Suite):
        if name.startswith("test_"):
            try:
                getattr(Suite(), name)()
            except Exception:
                failed.add(name)
    return failed


@pytest.mark.parametrize("sound", [Sound, Learns])
def test_a_sound_reward_passes(sound):
    assert failures(sound) == set()


@pytest.mark.parametrize(
    ("faulty", "caught_by"),
    [
        (AsksForTheResidual, "test_needs_are_declared"),
        (ReturnsAnArray, "test_is_a_finite_number"),
        (IsConstant, "test_is_a_finite_number"),
        (IsUnseeded, "test_same_experience_same_reward"),
        (Remembers, "test_reset_forgets_everything"),
        (SharesItsCount, "test_instances_share_nothing"),
        (WritesToTheMap, "test_leaves_the_experience_alone"),
        (KeepsTheMap, "test_keeps_no_array_of_the_experience"),
        (DividesByZero, "test_survives_empty_depth"),
        (WorksOnlyInRooms, "test_survives_standing_still"),
        (ReturnsItsOwnArray, "test_state_is_arrays_that_stay_as_they_are"),
        (ReturnsObjects, "test_state_is_arrays_that_stay_as_they_are"),
        (DoesNotLoad, "test_state_round_trips"),
    ],
)
def test_each_fault_is_caught(faulty, caught_by):
    assert caught_by in failures(faulty)


def test_nan_fails_the_tests_of_finite_values_alone():
    """NaN differs from itself, which must not be taken for chance or for a missing reset."""
    assert failures(IsNaN) == {"test_is_a_finite_number", "test_survives_empty_depth", "test_survives_standing_still"}
