"""The choice of source frames in rooms of boxes, whose depth is exact."""

import math
from collections.abc import Mapping

import numpy as np
import pytest

from deux.geometry.camera import Camera
from deux.geometry.poses import camera_pose
from deux.geometry.source_frames import SourceRule, SourceView, choose_sources, has_parallax, visible_points
from deux.testing.box_world import Box, BoxWorld

CAMERA = Camera(64, 64)
PILLAR = Box(1.8, 3.0, 2.2, 3.4)  # one metre in front of a robot that stands in the middle of the room
Place = tuple[float, float, float]


def world(*boxes: Box, camera: Camera = CAMERA) -> BoxWorld:
    return BoxWorld(4.0, 6.0, boxes, camera)


def depth_and_pose(room: BoxWorld, place: Place) -> tuple[np.ndarray, np.ndarray]:
    x, z, degrees = place
    pose = camera_pose(x, 1.25, z, math.radians(degrees))
    return room.render(pose[None], frozenset())[0].depth, pose


def view(room: BoxWorld, place: Place, density: float = 0.1) -> SourceView:
    depth, pose = depth_and_pose(room, place)
    sparse = np.where(np.random.default_rng(0).random(depth.shape) < density, depth, 0.0)
    return SourceView.of(pose, room.camera.intrinsics, sparse)


def views(room: BoxWorld, places: Mapping[int, Place]) -> dict[int, SourceView]:
    return {step: view(room, place) for step, place in places.items()}


def truly_visible(room: BoxWorld, target: SourceView, place: Place) -> np.ndarray:
    """By the dense depth of the source: what is there lies no more than a twentieth in front of the point."""
    depth, pose = depth_and_pose(room, place)
    local = (target.points - pose[:3, 3]) @ pose[:3, :3]
    columns, rows = np.rint((local / local[:, 2:]) @ room.camera.intrinsics.T)[:, :2].astype(int).T
    inside = (local[:, 2] > 0) & (rows >= 0) & (rows < 64) & (columns >= 0) & (columns < 64)
    there = depth[np.clip(rows, 0, 63), np.clip(columns, 0, 63)]
    return inside & (there > 0.95 * local[:, 2])


@pytest.mark.parametrize("place", [(2.6, 4.4, 0.0), (1.4, 4.0, -10.0), (2.0, 4.8, 20.0), (2.5, 4.4, 5.0)])
def test_hidden_points_are_found_by_the_sparse_points_alone(place: Place) -> None:
    room = world(PILLAR)
    target = view(room, (2.0, 4.4, 0.0))
    found = visible_points(target, view(room, place))
    expected = truly_visible(room, target, place)
    assert 0.2 < expected.mean() < 1.0
    assert (found == expected).mean() > 0.9
    blind = SourceView(depth_and_pose(room, place)[1], CAMERA.intrinsics, (64, 64), np.empty((0, 2)), np.empty(0))
    hidden = visible_points(target, blind) & ~expected  # inside the image; without points nothing hides them
    assert found[hidden].sum() <= hidden.sum() / 3


def test_points_behind_the_camera_are_not_seen() -> None:
    room = world()
    assert not visible_points(view(room, (2.0, 4.0, 0.0)), view(room, (2.0, 4.0, 180.0))).any()


def test_turns_on_the_spot_give_way_to_steps() -> None:
    places = {
        -5: (2.0, 4.5, 0.0),
        **{step: (2.0, 4.0, 10.0 * (step + 4)) for step in range(-4, 0)},
        1: (2.0, 4.0, 50.0),
    }
    places |= {2: (1.8, 3.85, 50.0), 3: (1.6, 3.7, 50.0)}
    room = world()
    target = view(room, (2.0, 4.0, 40.0))
    chosen = choose_sources(target, views(room, places))
    assert set(chosen.steps) == {2, 3}
    assert chosen.parallax
    assert not has_parallax(target, [view(room, places[-1]), view(room, places[-2])])


def test_the_rule_is_distance_heading_and_overlap() -> None:
    room = world()
    target = view(room, (2.0, 4.0, 0.0))
    qualifies = {
        (2.0, 3.9, 0.0): False,  # 0.1 m
        (2.0, 3.8, 0.0): True,
        (2.0, 3.3, 0.0): True,
        (2.0, 3.1, 0.0): False,  # 0.9 m
        (2.2, 4.0, 35.0): True,
        (2.2, 4.0, 45.0): False,
    }
    assert {place: has_parallax(target, [view(room, place)]) for place in qualifies} == qualifies
    wall = world(Box(2.05, 0.0, 2.15, 6.0))  # stands between the two cameras
    beside = view(wall, (2.4, 4.0, 0.0))
    assert has_parallax(view(world(), (1.8, 4.0, 0.0)), [view(world(), (2.4, 4.0, 0.0))])
    assert not has_parallax(view(wall, (1.8, 4.0, 0.0)), [beside], SourceRule(min_overlap=0.5))


def test_of_two_equal_pairs_that_on_both_sides_in_time_is_taken() -> None:
    room = world()
    places = {-2: (2.3, 4.0, 0.0), -1: (2.25, 4.0, 0.0), 1: (1.75, 4.0, 0.0), 2: (1.7, 4.0, 0.0)}
    steps = choose_sources(view(room, (2.0, 4.0, 0.0)), views(room, places)).steps
    assert math.prod(steps) < 0


def test_sources_that_complete_each_other_are_preferred() -> None:
    """Both sides of a pillar: what one camera cannot see the other sees. The better one alone is there twice."""
    room = world(Box(1.8, 3.2, 2.2, 3.6))
    places = {1: (2.4, 4.4, 0.0), 2: (2.4, 4.4, 0.0), 3: (1.6, 4.4, 0.0)}
    steps = choose_sources(view(room, (2.0, 4.4, 0.0)), views(room, places)).steps
    assert 3 in steps


def test_where_nothing_qualifies_the_best_there_is_is_taken() -> None:
    room = world()
    places = {-2: (2.0, 4.0, 30.0), -1: (2.0, 4.0, 15.0), 1: (2.0, 4.05, 0.0), 2: (2.0, 4.0, 100.0)}
    chosen = choose_sources(view(room, (2.0, 4.0, 0.0)), views(room, places))
    assert chosen.steps[0] == 1
    assert 2 not in chosen.steps
    assert not chosen.parallax


def test_one_candidate_is_too_few() -> None:
    room = world()
    assert choose_sources(view(room, (2.0, 4.0, 0.0)), {1: view(room, (2.0, 3.8, 0.0))}).steps == ()


def test_a_target_without_points_takes_what_is_next_to_it() -> None:
    room = world()
    places = {step: (2.0, 4.0 - 0.2 * step, 0.0) for step in (-2, -1, 1, 2)}
    chosen = choose_sources(view(room, (2.0, 4.0, 0.0), density=0.0), views(room, places))
    assert set(chosen.steps) == {-1, 1}
    assert not chosen.parallax


def test_the_score_is_that_of_mvsnet_where_nothing_is_hidden() -> None:
    """Candidates are ranked as by a sum over the points that is written down from the paper."""
    room = world()
    target = view(room, (2.0, 4.0, 0.0))
    places = {1: (2.2, 4.0, 0.0), 2: (2.4, 4.0, 0.0), 3: (2.7, 4.0, 0.0)}

    def score(place: Place) -> float:
        total = 0.0
        _, pose = depth_and_pose(room, place)
        for point, seen in zip(target.points, truly_visible(room, target, place), strict=True):
            one, other = target.pose[:3, 3] - point, pose[:3, 3] - point
            angle = math.degrees(math.acos(one @ other / np.linalg.norm(one) / np.linalg.norm(other)))
            sigma = 1.0 if angle <= 5.0 else 10.0
            total += seen * math.exp(-((angle - 5.0) ** 2) / (2 * sigma**2))
        return total

    ranked = sorted(places, key=lambda step: -score(places[step]))
    found = views(room, places)
    for left_out in ranked:
        pair = {step: found[step] for step in ranked if step != left_out}
        assert choose_sources(target, pair).steps == tuple(step for step in ranked if step != left_out)
