"""Depth maps of an analytic scene confirm each other; blurred steps and wrong depths are confirmed by none."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from deux.geometry.depth_agreement import REACH, PosedDepth, agreeing_pixels, confirming_frames
from deux.geometry.poses import camera_pose

INTRINSICS = np.array([[60.0, 0.0, 39.5], [0.0, 60.0, 29.5], [0.0, 0.0, 1.0]])
WALL, BOARD, BOARD_EDGES = 4.0, 2.0, (-0.4, 0.4)


def pose(x: float, yaw: float = 0.0) -> np.ndarray:
    return camera_pose(x, 1.25, 0.0, yaw)


def depth(x: float) -> np.ndarray:
    """A wall 4 m ahead, and before it a board 2 m ahead that reaches from x = -0.4 m to 0.4 m, seen from x."""
    columns = np.arange(80)
    across = x + BOARD * (columns - INTRINSICS[0, 2]) / INTRINSICS[0, 0]
    row = np.where((across > BOARD_EDGES[0]) & (across < BOARD_EDGES[1]), BOARD, WALL)
    return np.tile(row, (60, 1))


def views(*places: float, blur: float = 0.0) -> list[PosedDepth]:
    maps = [gaussian_filter(depth(x), blur) if blur else depth(x) for x in places]
    return [PosedDepth(one, INTRINSICS, pose(x)) for one, x in zip(maps, places, strict=True)]


def test_exact_depth_is_confirmed_where_others_see_it() -> None:
    target, *others = views(0.0, -0.3, 0.3)
    agreeing = agreeing_pixels(target, others, 0.03)
    assert agreeing[:, 32:48].all()  # the board
    assert agreeing[:, [10, 70]].all()  # the wall, seen by all three
    assert not agreeing[:, [0, 79]].any()  # out of one of the two others


def test_a_blurred_step_is_not_confirmed() -> None:
    target, *others = views(0.0, -0.3, 0.3, blur=2.0)
    agreeing = agreeing_pixels(target, others, 0.03)
    between = (target.depth > 1.1 * BOARD) & (target.depth < 0.9 * WALL)
    assert between.any()
    assert not agreeing[between].any()
    assert agreeing[:, 36:44].all()


def test_the_tolerance_is_a_fraction_of_the_distance() -> None:
    target, *others = views(0.0, -0.3, 0.3)
    wrong = target._replace(depth=target.depth * 1.02)
    assert agreeing_pixels(wrong, others, 0.025)[30, 40]
    assert not agreeing_pixels(wrong, others, 0.015)[30, 40]


def test_a_slanted_floor_agrees_in_a_small_image() -> None:
    """A floor 1.25 m below level cameras of 24 x 16 pixels: depth changes by up to a half from row to row."""
    intrinsics = np.array([[14.0, 0.0, 11.5], [0.0, 14.0, 7.5], [0.0, 0.0, 1.0]])
    rows = np.arange(16)
    with np.errstate(divide="ignore"):
        floor = np.where(rows > 8, 1.25 * 14.0 / (rows - 7.5), 0.0)
    depth = np.tile(floor[:, None], (1, 24))
    target, *others = [
        PosedDepth(depth, intrinsics, camera_pose(x, 1.25, z, yaw))
        for x, z, yaw in [(0.0, 0.0, 0.0), (0.2, 0.1, 0.1), (-0.2, -0.1, -0.1)]
    ]
    assert agreeing_pixels(target, others, 0.01)[11:15, 6:18].all()


def test_pixels_without_depth_confirm_nothing() -> None:
    target, *others = views(0.0, -0.3, 0.3)
    empty = [other._replace(depth=np.zeros_like(other.depth)) for other in others]
    assert not agreeing_pixels(target, empty, 0.03).any()


def test_frames_that_stand_alone_keep_their_points() -> None:
    (target,) = views(0.0)
    assert agreeing_pixels(target, [], 0.03).all()


def test_points_behind_a_camera_are_not_confirmed() -> None:
    (target,) = views(0.0)
    behind = target._replace(pose=camera_pose(0.0, 1.25, 0.3, np.pi))
    assert not agreeing_pixels(target, [behind], 0.5).any()


@pytest.mark.parametrize(
    ("places", "index", "chosen"),
    [
        ([0.1 * step for step in range(21)], 10, [8, 2, 12, 18]),  # 0.15 m to 0.8 m away, nearest and farthest
        ([0.1 * step for step in range(21)], 0, [2, 8]),  # nothing before it
        ([0.0, 0.4], 0, [1]),
        ([0.001 * step for step in range(21)], 10, []),  # none stands apart
        ([0.031 * step for step in range(31)], 15, [10, 5, 20, 25]),  # no farther in time than REACH
    ],
)
def test_confirming_frames_stand_apart(places: list[float], index: int, chosen: list[int]) -> None:
    assert confirming_frames([pose(x) for x in places], index) == chosen
    assert all(abs(other - index) <= REACH for other in chosen)


def test_frames_that_look_elsewhere_confirm_nothing() -> None:
    assert confirming_frames([pose(0.0), pose(0.4, yaw=1.5), pose(0.4, yaw=0.2)], 0) == [2]
