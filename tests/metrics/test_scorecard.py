"""The scorecard, against cameras that move along a flat wall at known depth."""

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from deux.contracts import FrameReference, Reader, Triplet
from deux.errors import DeuxError
from deux.geometry.camera import Camera
from deux.geometry.poses import camera_pose, source_from_target
from deux.metrics.scorecard import (
    PARALLAX,
    Scorecard,
    depth_histogram,
    depth_shares,
    moved_share,
    score,
    total_variation,
)

CAMERA = Camera(width=32, height=32)


@dataclass(frozen=True)
class Wall(Reader):
    """Cameras that look along -Z at a wall, whose plane is at z = -depth."""

    folder: Path
    poses: tuple[tuple[str, float, float, float], ...]  # sequence, x, z, yaw in degrees
    depth: float = 2.0
    known: bool = True

    def triplets(self, split, offsets):
        frames = [FrameReference(one[0], str(number)) for number, one in enumerate(self.poses)]
        return [Triplet(frames[k], tuple(frames[k + o] for o in offsets)) for k in range(2, len(frames))]

    def image(self, frame):
        raise NotImplementedError

    sparse_depth = image

    def intrinsics(self, frame):
        return CAMERA.intrinsics

    def pose(self, frame):
        _, x, z, yaw = self.poses[int(frame.name)]
        return camera_pose(x, 0.88, z, np.radians(yaw))

    def ground_truth(self, frame):
        return np.full((32, 32), self.depth, np.float32) if self.known else None


def along(count: int, step: float, yaw: float = 0.0) -> tuple[tuple[str, float, float, float], ...]:
    return tuple(("flat-00", 0.1 + step * k, 0.1, yaw * k) for k in range(count))


@pytest.mark.parametrize(
    ("metres", "degrees", "useful"),
    [(0.25, 0, True), (0.0, 30, False), (0.1, 0, False), (0.9, 0, False), (0.25, 39, True), (0.25, 41, False)],
)
def test_parallax_needs_a_baseline_and_a_common_view(metres, degrees, useful):
    assert PARALLAX.apart(camera_pose(0, 1, 0, 0.3), camera_pose(metres, 1, 0, 0.3 + np.radians(degrees))) == useful


@pytest.mark.parametrize("depth", [1.0, 3.0, 8.0])
def test_a_sideways_step_moves_all_pixels_of_a_wall_by_the_same_disparity(depth):
    """f b / z - f b / (1.1 z) = f b / (11 z): whether that is a quarter pixel decides over all pixels that stay."""
    step = 0.4
    matrix = source_from_target(camera_pose(0, 1, 0, 0), camera_pose(step, 1, 0, 0))
    found = moved_share(np.full((32, 32), depth), CAMERA.intrinsics, [matrix])
    disparity = CAMERA.focal_length * step / depth
    columns = np.arange(32) - disparity
    expected = np.mean(columns >= -0.5) if disparity / 11 >= 0.25 else 0.0
    assert found == pytest.approx(expected)


def test_a_turn_on_the_spot_moves_nothing():
    matrix = source_from_target(camera_pose(0, 1, 0, 0), camera_pose(0, 1, 0, 0.3))
    assert moved_share(np.full((32, 32), 0.5), CAMERA.intrinsics, [matrix]) == 0.0


def test_a_step_forward_moves_the_rim_and_not_the_middle():
    """A point r pixels from the middle goes to r z / (z - b): from the two depths follows which r move enough."""
    depth, step = 1.0, 0.25
    matrix = source_from_target(camera_pose(0, 1, 0, 0), camera_pose(0, 1, -step, 0))
    u, v = np.meshgrid(np.arange(32) - 15.5, np.arange(32) - 15.5)
    factor = depth / (depth - step) - 1.1 * depth / (1.1 * depth - step)
    inside = np.maximum(abs(u), abs(v)) * depth / (depth - step) <= 16.0
    expected = np.mean((np.hypot(u, v) * factor >= 0.25) & inside)
    found = moved_share(np.full((32, 32), depth), CAMERA.intrinsics, [matrix])
    assert found == pytest.approx(expected)
    assert 0 < found < 1


def test_pixels_behind_the_source_camera_and_without_depth_do_not_count():
    behind = source_from_target(camera_pose(0, 1, 0, 0), camera_pose(0, 1, -3.0, 0))
    assert moved_share(np.full((8, 8), 1.0), CAMERA.intrinsics, [behind]) == 0.0
    assert np.isnan(moved_share(np.zeros((8, 8)), CAMERA.intrinsics, [behind]))


def test_shares_and_distance_of_known_depths():
    near, far = np.array([[0.5, 0.0]]), np.array([[2.0, 4.0]])
    assert depth_shares([near, far]) == pytest.approx({"near": 1 / 3, "middle": 1 / 3, "far": 1 / 3})
    assert total_variation(depth_histogram([near]), depth_histogram([far])) == 1.0
    assert total_variation(depth_histogram([near, far]), depth_histogram([far, near])) == 0.0
    assert total_variation(depth_histogram([far]), depth_histogram([np.array([[2.0]])])) == pytest.approx(0.5)


def test_a_walk_along_a_wall_has_parallax_in_all_frames_and_visits_each_place_once():
    card = score(Wall(Path("d"), along(10, 0.25)), tests=Wall(Path("t"), along(4, 0.25), depth=0.5))
    assert (card.frames, card.sampled, card.parallax) == (8, 8, 1.0)
    xs = 0.1 + 0.25 * np.arange(2, 10)
    assert card.places == card.views == len(set(np.floor(xs / 0.5)))
    assert (card.near, card.middle, card.far) == (0.0, 1.0, 0.0)
    assert card.test_shares == {"near": 1.0, "middle": 0.0, "far": 0.0}
    assert card.depth_distance == 1.0


def test_turning_on_the_spot_shows_many_views_of_one_place_without_parallax():
    card = score(Wall(Path("d"), along(14, 0.0, yaw=30.0)))
    assert (card.parallax, card.moved, card.places, card.views) == (0.0, 0.0, 1, 12)
    assert card.depth_distance is None


def test_places_are_those_of_a_scene_and_not_of_an_episode():
    poses = [(f"flat-view{k:04d}", 0.1, 0.1, 0.0) for k in range(6)]
    assert score(Wall(Path("d"), tuple(poses))).places == 1
    poses[-1] = ("house-view0000", 0.1, 0.1, 0.0)
    assert score(Wall(Path("d"), tuple(poses))).places == 2


def test_recordings_whose_names_differ_in_a_number_are_two_scenes():
    poses = [(f"seq-{1 + k // 3:02d}", 0.1, 0.1, 0.0) for k in range(9)]
    assert score(Wall(Path("d"), tuple(poses))).places == 3


def test_large_datasets_are_sampled_for_pixels_only():
    card = score(Wall(Path("d"), along(50, 0.25)), most_frames=5)
    assert (card.frames, card.sampled) == (48, 5)


@pytest.mark.parametrize(
    ("poses", "known", "says"), [(2, True, "lists no train frames"), (4, False, "no ground truth")]
)
def test_a_missing_scorecard_is_reported_with_its_cause(poses, known, says):
    with pytest.raises(DeuxError, match=says):
        score(Wall(Path("d"), along(poses, 0.25), known=known))


def test_frames_are_judged_with_the_sources_that_the_model_is_trained_with():
    """Turns on the spot after a step: t-1 and t-2 show no parallax, the frame before the step does."""
    step = (("flat-00", 0.1, 0.1, 0.0), *(("flat-00", 0.35, 0.1, 3.0 * k) for k in range(6)))

    class Remembering(Wall):
        def chosen_triplets(self, split):
            targets = self.triplets(split, (-1, -2))
            return [Triplet(one.target, (FrameReference("flat-00", "0"), one.sources[0])) for one in targets]

    recent, baseline = (
        score(Remembering(Path("d"), step, depth=1.0), choice=choice) for choice in ("recent", "baseline")
    )
    assert (recent.sources, baseline.sources) == ("recent", "baseline")
    assert (recent.parallax, baseline.parallax) == (pytest.approx(1 / 5), 1.0)
    assert recent.moved < baseline.moved
    for card in (recent, baseline):
        assert f"sources: {card.sources}" in card.table("Scorecard").markdown()


def test_a_scorecard_is_read_as_it_was_written(tmp_path):
    card = score(Wall(Path("d"), along(10, 0.25)), tests=Wall(Path("t"), along(4, 0.25), depth=0.5))
    card.save(tmp_path)
    assert Scorecard.load(tmp_path) == card
    printed = card.table("Scorecard").markdown()
    assert f"| places | {card.places} |" in printed  # a whole number
    assert f"| near | {card.near:.3f} | {card.test_shares['near']:.3f} |" in printed


def test_a_scorecard_of_an_earlier_version_judges_recent_sources_and_knows_no_actions(tmp_path):
    score(Wall(Path("d"), along(10, 0.25)), choice="recent").save(tmp_path)
    content = json.loads((tmp_path / "scorecard.json").read_text())
    added = {name: content.pop(name) for name in ("sources", "actions", "bumps", "area", "floor_share")}
    assert added == {"sources": "recent", "actions": None, "bumps": None, "area": None, "floor_share": None}
    (tmp_path / "scorecard.json").write_text(json.dumps(content))
    card = Scorecard.load(tmp_path)
    assert (card.sources, card.actions, card.area) == ("recent", None, None)


@pytest.mark.parametrize("change", [{"parallax": "much"}, {"parallax": None}, {"beauty": 1.0}])
def test_what_is_no_scorecard_is_reported(tmp_path, change):
    score(Wall(Path("d"), along(10, 0.25))).save(tmp_path)
    content = json.loads((tmp_path / "scorecard.json").read_text())
    (tmp_path / "scorecard.json").write_text(json.dumps({**content, **change}))
    with pytest.raises(DeuxError, match=r"is not a scorecard of deux \(.*collect or run it again"):
        Scorecard.load(tmp_path)
