"""What robots did and saw, against the simulator's own word and the study that measures episodes as they happen."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from deux.collection.episodes import EpisodePlan
from deux.collection.exploration import explore
from deux.collection.viewpoints import collect_viewpoints, plan_viewpoints
from deux.contracts import Action, Robot
from deux.environment.memory import ExplorationMemory
from deux.errors import DeuxError
from deux.geometry.camera import Camera
from deux.geometry.poses import camera_pose
from deux.io.calibration import read_pose, write_matrix
from deux.io.images import read_depth, write_depth
from deux.io.layout import SequencePaths
from deux.metrics import explored_places
from deux.metrics.explored_places import ExploredPlaces, measure_explored_places
from deux.registry import registry
from deux.studies.exploration_meter import PIXELS, Track, measure_exploration
from deux.testing.box_world import Box, BoxWorld

CAMERA = Camera(PIXELS, PIXELS)
STEPS = 40


class Counter(BoxWorld):
    """A room with a pillar that counts the steps forward that it cuts short."""

    bumps = 0

    def __init__(self) -> None:
        super().__init__(5.0, 4.0, (Box(1.0, 2.6, 2.0, 3.0),), CAMERA)

    def step(self, action: Action) -> bool:
        cut_short = super().step(action)
        Counter.bumps += cut_short
        return cut_short


def collect(dataset: Path, *episodes: str, explorer: str = "random") -> int:
    """Collect episodes of these names; gives the number of bumps."""
    Counter.bumps = 0
    plans = [
        EpisodePlan(dataset / "data" / name, Counter().scene, seed=number, steps=STEPS)
        for number, name in enumerate(episodes)
    ]
    explore(plans, lambda scene: Counter(), lambda: registry().create("explorers", explorer, {}))
    return Counter.bumps


def measure(dataset: Path) -> ExploredPlaces:
    return measure_explored_places(dataset, CAMERA, Robot())


def studied(sequence: Path):
    """The same by the study, which draws the episode's poses once more."""
    poses = [read_pose(path) for path in sorted((sequence / "absolute_pose").iterdir())]
    actions = [Action(one) for one in json.loads((sequence / "episode.json").read_text())["actions"]]
    return measure_exploration(Counter(), Track(poses, [False] * len(poses), actions), {}, seed=0, steps=len(poses))


def test_bumps_and_actions_are_those_that_the_simulator_tells(tmp_path):
    bumps = collect(tmp_path, "room-00", "room-01")
    found = measure(tmp_path)
    assert found.actions == 2 * STEPS
    assert found.bumps == pytest.approx(100 * bumps / (2 * STEPS))
    assert bumps > 0


def test_area_and_share_of_one_episode_are_those_of_the_study(tmp_path):
    collect(tmp_path, "room-00")
    found, known = measure(tmp_path), studied(tmp_path / "data" / "room-00")
    assert found.area == pytest.approx(known.area_seen, rel=0.02)  # depth on disk is rounded
    assert found.floor_share == pytest.approx(known.floor_covered, abs=0.02)
    assert found.area_per_action == pytest.approx(found.area / STEPS)


def test_what_two_episodes_of_a_place_see_counts_once_and_another_place_counts_for_itself(tmp_path):
    for name, episodes in {"one": ["room-00"], "same": ["room-00", "room-01"], "other": ["room-00", "hall-00"]}.items():
        collect(tmp_path / name, *episodes)
    one, same, other = (measure(tmp_path / name) for name in ("one", "same", "other"))
    whole = 5.2 * 4.2  # with the cells that the walls' faces fall into
    assert one.area <= same.area <= whole
    assert same.floor_share >= one.floor_share
    assert other.area == pytest.approx(one.area + studied(tmp_path / "other/data/hall-00").area_seen, rel=0.02)
    # Both have one free floor, so that the share of both is the mean of theirs.
    second = studied(tmp_path / "other/data/hall-00").floor_covered
    assert other.floor_share == pytest.approx((one.floor_share + second) / 2, abs=0.02)


def test_free_viewpoints_have_an_area_and_no_actions(tmp_path):
    plans = plan_viewpoints(tmp_path / "data", Counter().scene, seed=0, count=12, ideal=True)
    collect_viewpoints([plans], lambda scene: Counter())
    found = measure(tmp_path)
    assert (found.actions, found.bumps, found.area_per_action) == (None, None, None)
    assert 5.0 < found.area <= 5.2 * 4.2
    assert 0.3 < found.floor_share <= 1.0
    (kept,) = tmp_path.glob("data/*/free_floor.npz")
    assert kept.parent.name.endswith("-view0000")


def test_a_dataset_of_an_earlier_version_has_no_share_of_the_free_floor(tmp_path):
    collect(tmp_path, "room-00")
    known = measure(tmp_path)
    (tmp_path / "data/room-00/free_floor.npz").unlink()
    assert measure(tmp_path) == replace(known, floor_share=None)


def test_a_damaged_record_is_reported(tmp_path):
    collect(tmp_path, "room-00")
    (tmp_path / "data/room-00/episode.json").write_text("{}")
    with pytest.raises(DeuxError, match=r"episode\.json is damaged, it contains no episode"):
        measure(tmp_path)


def test_depth_maps_are_read_a_share_ahead(tmp_path, monkeypatch):
    """So that memory does not grow with the length of an episode."""
    collect(tmp_path, "room-00")
    expected, read, ahead = measure(tmp_path), [], []

    def counted(path):
        read.append(path)
        return read_depth(path)

    class Watched(ExplorationMemory):
        def see(self, *arguments):
            ahead.append(len(read) - len(ahead))
            super().see(*arguments)

    monkeypatch.setattr(explored_places, "read_depth", counted)
    monkeypatch.setattr(explored_places, "ExplorationMemory", Watched)
    monkeypatch.setattr(explored_places, "_READ_AHEAD", 8)
    assert measure(tmp_path) == expected
    assert len(read) == len(ahead) == STEPS
    assert max(ahead) <= 8


@pytest.mark.parametrize(("along", "climb", "bump"), [(0.25, 0.0, False), (0.235, 0.1, True), (0.25, 0.1, False)])
def test_a_step_is_cut_short_by_its_way_along_the_floor(along, climb, bump):
    """As the simulator judges it: on a ramp the way through space is longer."""
    before, after = camera_pose(0.0, 1.25, 0.0, 0.0), camera_pose(0.0, 1.25 + climb, -along, 0.0)
    assert explored_places._is_bump(before, after, Robot(forward_step=0.25)) is bump


@pytest.mark.parametrize("distance", [1.0, 2.0])
def test_the_area_is_what_the_camera_looks_over(tmp_path, distance):
    """90 degrees of view up to a wall: a triangle of the distance squared, from which the robot's blind spot is cut."""
    paths = SequencePaths(tmp_path / "data" / "room-00")
    rays, robot = CAMERA.rays(), Robot()
    with np.errstate(divide="ignore"):
        floor = np.where(rays[..., 1] > 0, robot.camera_height / rays[..., 1], np.inf)
    for kind in ("image", "ground_truth", "absolute_pose"):
        paths.file(kind, "000000").parent.mkdir(parents=True)
    paths.file("image", "000000").touch()
    write_depth(paths.file("ground_truth", "000000"), np.minimum(floor, distance).astype(np.float32))
    write_matrix(paths.file("absolute_pose", "000000"), camera_pose(0.0, robot.camera_height, 0.0, 0.0))
    blind = {1.0: 0.6, 2.0: 0.75}[distance]  # at most what is nearer than the lower edge of the picture shows
    assert distance**2 - blind < measure(tmp_path).area < distance**2 + 0.5
