"""The suite must pass a sound explorer and catch each fault that it is there to catch."""

import random
import subprocess
import sys

import numpy as np
import pytest

from deux.contracts import Action, Explorer, ExplorerMap, Need
from deux.geometry.grid import GridFrame
from deux.mapping.recovery import Recovery
from deux.testing.box_world import BoxWorld
from deux.testing.explorers import TRAPS, ExplorerSuite, observe


class Sound(Explorer):
    def reset(self, episode):
        self.rng = np.random.default_rng(episode.seed)
        self.recovery = Recovery(episode.robot, self.rng)

    def act(self, observation):
        action = self.recovery.action(observation.pose, observation.collided)
        return Action(int(self.rng.integers(3))) if action is None else action


class Unseeded(Sound):
    def reset(self, episode):
        super().reset(episode)
        self.rng = np.random.default_rng()


class KeepsState(Sound):
    rng = None

    def reset(self, episode):
        kept = self.rng
        super().reset(episode)
        self.rng = kept or self.rng


class NeverTurnsAway(Sound):
    def act(self, observation):
        return Action.FORWARD


class TurnsOnTheSpot(Sound):
    def act(self, observation):
        return Action.LEFT


class Stops(Sound):
    def act(self, observation):
        return Action.STOP if observation.collided else super().act(observation)


class ReturnsNumbers(Sound):
    def act(self, observation):
        return int(super().act(observation))


class Undeclared(Sound):
    def act(self, observation):
        return Action.FORWARD if observation.sensor_depth.mean() > 1.0 else Action.LEFT


class WritesToImages(Sound):
    def act(self, observation):
        observation.rgb[:] = 0
        return super().act(observation)


class TrustsResiduals(Sound):
    needs = frozenset({Need.RESIDUAL})

    def act(self, observation):
        if observation.step < 3:
            return Action.LEFT
        assert np.isfinite(observation.uncertainty)
        return Action.RIGHT


class DividesByDepth(Sound):
    needs = frozenset({Need.SENSOR_DEPTH})

    def act(self, observation):
        nearest = observation.sensor_depth[observation.sensor_depth > 0.0].min()
        return Action.FORWARD if nearest > 0.5 else Action.LEFT


class WritesToTheFloor(Sound):
    needs = frozenset({Need.FREE_SPACE})

    def reset(self, episode):
        super().reset(episode)
        episode.free_space.free[:] = True


class StandsOnTheFloor(Sound):
    needs = frozenset({Need.FREE_SPACE})

    def reset(self, episode):
        super().reset(episode)
        self.floor = episode.free_space

    def act(self, observation):
        row, column = self.floor.frame.cell(*observation.pose[[0, 2], 3])
        assert self.floor.free[row - 1 : row + 2, column - 1 : column + 2].all(), "there is no room to stand"
        return super().act(observation)


class GivesUpWhenWalledIn(Sound):
    needs = frozenset({Need.SENSOR_DEPTH})

    def act(self, observation):
        assert observation.sensor_depth.max() > 0.6, "nothing is far away"
        return super().act(observation)


class CrookedMap(Sound):
    def map(self):
        return ExplorerMap(GridFrame(0.0, 0.0, 4, 5), np.zeros((5, 4), np.int8))


class WithMap(Sound):
    occupancy = np.zeros((4, 5), np.int8)
    uncertainty = np.zeros((4, 5), np.float32)

    def map(self):
        return ExplorerMap(GridFrame(0.0, 0.0, 4, 5), self.occupancy, self.uncertainty)


class MapOfFloats(WithMap):
    occupancy = np.zeros((4, 5))


class InfiniteMap(WithMap):
    uncertainty = np.full((4, 5), np.inf, np.float32)


class DrawsForTheMap(Sound):
    def map(self):
        self.rng.random()
        return None


class GrowsByAsking(Sound):
    def reset(self, episode):
        super().reset(episode)
        self.occupancy = np.zeros((4, 5), np.int8)

    def map(self):
        self.occupancy[0, 0] = 2 if self.occupancy[0, 0] else 1
        return ExplorerMap(GridFrame(0.0, 0.0, 4, 5), self.occupancy.copy())


class DrawsGlobally(Sound):
    def reset(self, episode):
        super().reset(episode)
        random.seed(episode.seed)

    def act(self, observation):
        action = self.recovery.action(observation.pose, observation.collided)
        return Action(random.randrange(3)) if action is None else action


class CountsInItsClass(Sound):
    count: list = []  # noqa: RUF012

    def reset(self, episode):
        super().reset(episode)
        self.count.clear()

    def act(self, observation):
        self.count.append(observation.step)
        return Action.LEFT if len(self.count) % 3 else super().act(observation)


class TakesRowsForColumns(Sound):
    needs = frozenset({Need.SENSOR_DEPTH})

    def act(self, observation):
        rows, columns = observation.sensor_depth.shape
        assert observation.sensor_depth[columns - 1, rows - 1] >= 0.0
        return super().act(observation)


class FingerprintOfTheObject(Sound):
    def fingerprint(self):
        return str(id(self))


class FingerprintOfBytes(Sound):
    def fingerprint(self):
        return b"weights"


def failures(explorer_class, only=None):
    """Names of the suite's tests that fail for an explorer, of all or of one of them."""

    class Suite(ExplorerSuite):
        def make_explorer(self):
            return explorer_class()

    failed = set()
    for name in [only] if only else dir(Suite):
        if name.startswith("test_"):
            try:
                getattr(Suite(), name)()
            except Exception:
                failed.add(name)
    return failed


@pytest.mark.parametrize("sound", [Sound, Stops, WithMap])
def test_a_sound_explorer_passes(sound):
    assert failures(sound) == set()


@pytest.mark.parametrize("trap", TRAPS)
def test_a_trap_has_a_way_out_and_holds_a_robot_that_goes_forward(trap):
    world = trap()
    start = world.pose[[0, 2], 3]
    for _ in range(20):
        world.step(Action.FORWARD)
    assert np.hypot(*(world.pose[[0, 2], 3] - start)) < TRAPS[trap]
    space = trap().free_space()
    rows, columns = np.nonzero(space.free)
    x, z = space.frame.origin_x + columns * 0.05, space.frame.origin_z + rows * 0.05
    assert np.hypot(x - start[0], z - start[1]).max() > 1.0


@pytest.mark.parametrize(
    ("faulty", "caught_by"),
    [
        (Unseeded, "test_same_seed_same_actions"),
        (KeepsState, "test_reset_forgets_everything"),
        (ReturnsNumbers, "test_acts_legally"),
        (Undeclared, "test_acts_legally"),
        (WritesToImages, "test_leaves_the_observation_alone"),
        (TrustsResiduals, "test_survives_missing_residuals"),
        (DividesByDepth, "test_survives_empty_depth"),
        (CrookedMap, "test_map_is_consistent"),
        (MapOfFloats, "test_map_is_consistent"),
        (InfiniteMap, "test_map_is_consistent"),
        (DrawsForTheMap, "test_map_changes_nothing"),
        (GrowsByAsking, "test_map_changes_nothing"),
        (DrawsGlobally, "test_instances_share_nothing"),
        (CountsInItsClass, "test_instances_share_nothing"),
        (TakesRowsForColumns, "test_takes_images_that_are_not_square"),
        (FingerprintOfTheObject, "test_equal_explorers_have_one_fingerprint"),
        (FingerprintOfBytes, "test_equal_explorers_have_one_fingerprint"),
        (WritesToTheFloor, "test_acts_legally"),
        (StandsOnTheFloor, "test_survives_a_scene_of_one_cell"),
        (GivesUpWhenWalledIn, "test_survives_a_cell_of_its_own"),
        (NeverTurnsAway, "test_gets_out_of_traps"),
        (TurnsOnTheSpot, "test_gets_out_of_traps"),
    ],
)
def test_each_fault_is_caught(faulty, caught_by):
    assert failures(faulty, caught_by) == {caught_by}


def test_an_observation_holds_what_was_declared_and_nothing_else():
    fields = {
        Need.SENSOR_DEPTH: {"sensor_depth"},
        Need.PREDICTED_DEPTH: {"predicted_depth"},
        Need.RESIDUAL: {"residual", "uncertainty"},
        Need.LABELS: {"labels"},
        Need.FREE_SPACE: set(),
    }
    for need in Need:
        observation = observe(BoxWorld(3.0, 3.0), frozenset({need}), 5, False)
        optional = {name for names in fields.values() for name in names}
        assert {name for name in optional if getattr(observation, name) is not None} == fields[need]


class LeavesNeedsAsText(Sound):
    needs = "sensor_depth"


@pytest.mark.parametrize(
    ("faulty", "test", "told"),
    [
        (
            NeverTurnsAway,
            "test_gets_out_of_traps",
            r"at most 75 may \(`most_pushes`\): deux\.mapping\.recovery\.Recovery",
        ),
        (
            TurnsOnTheSpot,
            "test_gets_out_of_traps",
            r"get out within 250 actions \(`escape_steps`\): deux\.mapping\.recov",
        ),
        # An assertion without a message of its own shows its values, which pytest writes out where it rewrote the file.
        (LeavesNeedsAsText, "test_needs_are_declared", r"isinstance\('sensor_depth', frozenset\)"),
    ],
)
def test_what_is_wrong_is_named_in_the_failure(faulty, test, told):
    class Suite(ExplorerSuite):
        def make_explorer(self):
            return faulty()

    with pytest.raises(AssertionError, match=told):
        getattr(Suite(), test)()


def test_the_worlds_need_no_pytest():
    code = "import sys; sys.modules['pytest'] = None; import deux.testing.box_world"
    subprocess.run([sys.executable, "-c", code], check=True)
