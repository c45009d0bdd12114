import math

import numpy as np
import pytest

from deux.contracts import Episode, Robot
from deux.geometry.camera import Camera
from deux.geometry.grid import GridFrame
from deux.geometry.poses import camera_pose
from deux.mapping.informative_targets import InformativeTargets, MapNow
from deux.mapping.planning import distance_field
from deux.mapping.pursuit import Target

CAMERA = Camera(32, 32)
FRAME = GridFrame(0.0, 0.0, 80, 120, 0.1)
NOWHERE = np.zeros((0, 2), np.int64)


def room():
    """A closed room of 12 x 8 m with walls of 0.2 m."""
    occupancy = np.full(FRAME.shape, 2, np.int8)
    occupancy[:2] = occupancy[-2:] = 1
    occupancy[:, :2] = occupancy[:, -2:] = 1
    return occupancy


def now(occupancy=None, x=6.0, z=4.0, yaw=0.0, frontier_places=NOWHERE):
    occupancy = room() if occupancy is None else occupancy
    distance = distance_field(occupancy == 2, FRAME.cell(x, z))
    return MapNow(occupancy, FRAME, distance, camera_pose(x, 1.25, z, yaw), frontier_places)


def targets(**options):
    return InformativeTargets(Episode(0, 100, CAMERA, Robot()), np.random.default_rng(0), **options)


def show_walls(chooser, left, right, long=None):
    """Frames of the room's walls from 2 m with these residuals: those at x = 0.2 and 11.8, and the two long ones."""
    ends = [(2.15, z, math.pi / 2, left) for z in (2.0, 4.0, 6.0)]
    ends += [(9.85, z, -math.pi / 2, right) for z in (2.0, 4.0, 6.0)]
    sides = [(x, z, yaw, long) for x in np.arange(1.0, 12.0, 2.0) for z, yaw in ((2.15, 0.0), (5.85, math.pi))]
    for x, z, yaw, residual in ends + (sides if long is not None else []):
        values = np.full((32, 32), residual, np.float32)
        depth = np.full((32, 32), 2.0, np.float32)
        chooser.record(camera_pose(x, 1.25, z, yaw), depth, values, 1.0 - math.exp(-residual))


def heading(target):
    return math.atan2(target.place[0] - target.look_at[0], target.place[1] - target.look_at[1])


@pytest.mark.parametrize(("left", "right", "side"), [(0.5, 0.05, 1.0), (0.05, 0.5, -1.0)])
def test_it_goes_to_look_at_the_uncertain_wall(left, right, side):
    chooser = targets()
    show_walls(chooser, left, right, long=0.05)
    chosen = chooser.choose(now())
    assert side * math.sin(heading(chosen)) > 0.4  # a positive yaw looks along -x


def test_where_all_is_alike_a_value_is_the_share_of_the_image_that_shows_a_surface():
    """From the middle the long wall is 3.85 m away: within 5 m up to acos(3.85 / 5) = 39.6 degrees aside."""
    values = targets(residual_pose="constant").values(now(), np.array([[40, 60]]), on_the_way=False)
    assert values[0, 0] == pytest.approx(math.tan(math.acos(3.85 / 5.0)), abs=0.08)  # a ray is 5 degrees wide
    assert values[0, 3] == pytest.approx(0.0, abs=0.08)  # all that can be seen that way is more than 5 m away


def test_novelty_alone_prefers_what_was_not_seen():
    chooser = targets(residual_pose="constant")
    for yaw in (0.0, math.pi / 2, math.pi):
        for x in np.arange(2.0, 6.0, 0.5):
            chooser.mark_seen(camera_pose(x, 1.25, 4.0, yaw), room(), FRAME)
    assert chooser.choose(now()).place[0] > 6.0


def test_turns_without_motion_teach_nothing_and_leave_the_novelty():
    chooser = targets(residual_pose="constant")
    chooser.mark_seen(camera_pose(6.0, 1.25, 4.0, 0.0), room(), FRAME)
    before = chooser.values(now(), np.array([[40, 60]]), on_the_way=False)
    for yaw in (1.0, 2.0, 3.0):
        chooser.mark_seen(camera_pose(6.0, 1.25, 4.0, yaw), room(), FRAME)
    assert np.array_equal(chooser.values(now(), np.array([[40, 60]]), on_the_way=False), before)


def test_a_turn_right_after_a_step_has_parallax():
    """To the frame before the last one, which is a source frame too; after two turns there is none."""
    chooser = targets(residual_pose="constant")
    marked = []
    for x, yaw in ((5.0, 0.0), (5.25, 0.0), (5.25, -0.6), (5.25, -1.2), (5.5, -1.2), (5.5, -2.0)):
        before = chooser.values(now(), np.array([[15, 60]]), on_the_way=False)
        chooser.mark_seen(camera_pose(x, 1.25, 1.5, yaw), room(), FRAME)
        marked.append(not np.array_equal(chooser.values(now(), np.array([[15, 60]]), on_the_way=False), before))
    assert marked == [True, True, True, False, True, False]


@pytest.mark.parametrize("shift", [0.05, 0.1, 0.2])
def test_what_was_in_full_view_is_not_new_from_beside(shift):
    """All of it but what only comes into view: nothing slips between the rays that say what was seen."""
    seen, never = targets(residual_pose="constant"), targets(residual_pose="constant")
    seen.mark_seen(camera_pose(6.0, 1.25, 4.0, 0.0), room(), FRAME)
    cell = np.array([FRAME.cell(6.0 + shift, 4.0)])
    assert (
        seen.values(now(), cell, on_the_way=False)[0, 0] / never.values(now(), cell, on_the_way=False)[0, 0] < 0.32
    )  # (1 + 1) ** -2, and the rim


@pytest.mark.parametrize("guidance", [0.0, 0.5, 1.0])
def test_guidance_is_the_exponent_of_the_uncertainty(guidance):
    chooser, without = targets(guidance=guidance), targets(residual_pose="constant")
    show_walls(chooser, 0.36, 0.36, long=0.36)
    cells = np.array([[40, 35], [40, 85], [20, 60]])
    values, shares = (one.values(now(), cells, on_the_way=False) for one in (chooser, without))
    assert np.allclose(values, shares * 0.36**guidance)


def test_without_guidance_only_novelty_counts():
    guided, constant = targets(guidance=0.0), targets(residual_pose="constant")
    show_walls(guided, 0.3, 0.1)
    for x in np.arange(2.0, 6.0, 0.5):
        for chooser in (guided, constant):
            chooser.mark_seen(camera_pose(x, 1.25, 4.0, 0.0), room(), FRAME)
    cells = np.argwhere(room() == 2)[::97]
    assert np.allclose(guided.values(now(), cells, True), constant.values(now(), cells, True))


def test_the_unknown_is_worth_the_mean_error():
    occupancy = room()
    occupancy[:, 90:] = 0
    chooser = targets()
    show_walls(chooser, 0.3, 0.3)
    into_the_unknown, to_the_wall = (
        chooser.values(now(occupancy), np.array([[40, column]]), on_the_way=False) for column in (75, 35)
    )
    assert into_the_unknown[0, 9] == pytest.approx(0.3, rel=0.05)  # heading 9: a quarter turn right
    assert to_the_wall[0, 3] == pytest.approx(0.3, rel=0.05)


def test_what_the_way_shows_counts_once():
    """Along the room's axis every view shows the same wall ahead; only the parts that come into range are new."""
    chooser = targets(residual_pose="constant")
    there = now(x=2.0)
    cells = np.array([FRAME.cell(x, 4.0) for x in np.arange(2.05, 11.0, 0.5)])
    alone, along = (chooser.values(there, cells, on_the_way)[:, 9] for on_the_way in (False, True))
    assert np.all(along[1:] >= along[:-1])  # a longer way shows no less
    assert along[-1] < 0.6 * alone.sum()  # and far less than the sum of its views


def test_actions_count():
    """Of two walls that are alike the nearer one is chosen, unless actions do not count."""
    chosen = {
        side: targets(residual_pose="constant", on_the_way=False).choose(now(x=x)).place[0]
        for side, x in (("left", 2.0), ("right", 10.0))
    }
    assert chosen["left"] < 4.5
    assert chosen["right"] > 7.5
    free = [targets(residual_pose="constant", on_the_way=False, per_action=False).choose(now(x=x)) for x in (2.0, 10.0)]
    assert free[0] == free[1]


def test_without_revisits_only_frontiers_are_candidates():
    frontier = np.array([[20, 90]])
    chosen = targets(revisits=False).choose(now(frontier_places=frontier))
    assert FRAME.cell(*chosen.place) == (20, 90)
    assert targets(revisits=False).choose(now()) is not None  # none is left: known floor after all


def test_a_target_is_given_up_only_for_a_clearly_better_one():
    chooser = targets()
    show_walls(chooser, 0.5, 0.05)
    there = now()
    chosen = chooser.choose(there)
    assert not chooser.is_outdone(chosen, there)
    place = FRAME.centre(40, 100)
    poor = Target(place, look_at=(place[0] + 1.0, place[1]))
    assert chooser.is_outdone(poor, there)


def test_a_robot_without_floor_has_no_target():
    shut = np.ones(FRAME.shape, np.int8)
    assert targets().choose(now(shut)) is None
