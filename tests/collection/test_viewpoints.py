"""Free test poses: uniform over the floor, three frames each, resumable."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from mesh_world import RoomFile
from toy_world import ROBOT, ROOM, ToyScene, ToySimulator, run_travelled, tree

from deux.collection import viewpoints
from deux.collection.jobs import Executor
from deux.collection.local_execution import LocalExecutor
from deux.collection.viewpoints import MOTIONS, collect_viewpoints, plan_viewpoints, poses_before
from deux.contracts import Action
from deux.errors import DeuxError
from deux.geometry.grid import FreeSpace
from deux.geometry.poses import motion, yaw_of
from deux.io.calibration import read_pose


def poses(dataset: Path) -> np.ndarray:
    """Viewpoints x 3 frames x 4 x 4."""
    return poses_in(dataset / "data")


def poses_in(data: Path) -> np.ndarray:
    folders = sorted(data.iterdir())
    return np.array([[read_pose(folder / f"absolute_pose/00000{i}.txt") for i in range(3)] for folder in folders])


@pytest.mark.parametrize("motion", MOTIONS)
def test_the_poses_before_lead_to_the_pose(motion: tuple[Action, ...]) -> None:
    simulator = ToySimulator()
    expected = poses_before(0.3, -0.2, 2.0, motion, ROBOT)
    simulator.reset(*expected[0])
    for action, pose in zip(motion, expected[1:], strict=True):
        assert not simulator.step(action)
        np.testing.assert_allclose(simulator.state, pose, atol=1e-12)
    assert expected[-1] == (0.3, -0.2, 2.0)


def test_viewpoints_spread_over_floor_and_directions(tmp_path: Path) -> None:
    collect_viewpoints([plan_viewpoints(tmp_path / "data", ToyScene(), 0, 64)], ToySimulator)
    final = poses(tmp_path)[:, 2]
    quadrants = np.bincount(2 * (final[:, 0, 3] > 0) + (final[:, 2, 3] > 0), minlength=4)
    assert quadrants.min() >= 14  # of 64, 16 on average
    assert (np.abs(final[:, [0, 2], 3]) < ROOM[1, [0, 2]]).all()
    yaws = np.histogram([yaw_of(pose) for pose in final], bins=4, range=(-np.pi, np.pi))[0]
    assert yaws.min() >= 6


def test_each_viewpoint_ends_a_motion_with_a_step_forward(tmp_path: Path) -> None:
    collect_viewpoints([plan_viewpoints(tmp_path / "data", ToyScene(), 1, 20)], ToySimulator)
    for first, second, third in poses(tmp_path):
        moves = [motion(first, second), motion(second, third)]
        assert all(np.isclose(d, 0.25) ^ np.isclose(a, 10.0, atol=1e-6) for d, a in moves)
        assert any(np.isclose(d, 0.25) for d, _ in moves)


def test_only_missing_viewpoints_are_rendered(tmp_path: Path) -> None:
    plans = plan_viewpoints(tmp_path / "data", ToyScene(), 0, 4)
    made: list[ToySimulator] = []

    def make(scene: ToyScene) -> ToySimulator:
        made.append(ToySimulator(scene))
        return made[-1]

    collect_viewpoints([plans], make)
    before = tree(tmp_path)
    (plans[2].folder / "absolute_pose/000002.txt").unlink()
    collect_viewpoints([plans], make)
    assert tree(tmp_path) == before
    assert made[1].rendered == 3
    assert made[0].batches == [3] * 4  # each viewpoint's frames are drawn as one batch
    collect_viewpoints([plans], make)
    assert len(made) == 2


def test_few_viewpoints_are_made_here(tmp_path: Path) -> None:
    handed: list[int] = []

    def execute(run, jobs, count):  # type: ignore[no-untyped-def]
        handed.append(sum(job.size for job in jobs))

    few, many = (plan_viewpoints(tmp_path, ToyScene(f"room{count}"), 0, count) for count in (1, viewpoints._FEW))
    collect_viewpoints([few], ToySimulator, execute)
    assert handed == []
    assert few[0].finished
    collect_viewpoints([many], ToySimulator, execute)
    in_file = plan_viewpoints(tmp_path, RoomFile("kitchen", path=tmp_path / "kitchen.obj"), 0, 3)
    collect_viewpoints([in_file], ToySimulator, execute)  # type: ignore[arg-type]
    assert handed == [viewpoints._FEW, 3]


@pytest.mark.parametrize("two", [run_travelled, pytest.param(LocalExecutor(2), marks=pytest.mark.slow)])
def test_viewpoints_are_the_same_for_any_number_of_processes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, two: Executor
) -> None:
    monkeypatch.setattr(viewpoints, "_FEW", 0)
    scenes = [ToyScene("kitchen", "toy-1"), ToyScene("hall", "toy-22"), ToyScene("attic", "toy-333")]
    told: list[int] = []
    for folder, execute in {"one": LocalExecutor(1), "two": two}.items():
        floors = [plan_viewpoints(tmp_path / folder, scene, seed, 4, 1) for seed, scene in enumerate(scenes)]
        floors[1][2].folder.mkdir(parents=True)  # begun and not finished
        told.clear()
        collect_viewpoints(floors, ToySimulator, execute, lambda stage, done, total: told.append(done))
        assert told == list(range(1, 13))
    assert len(poses_in(tmp_path / "one")) == 12
    assert tree(tmp_path / "one") == tree(tmp_path / "two")


def test_a_scene_without_room_for_a_step_is_an_error(tmp_path: Path) -> None:
    class Cell(ToySimulator):
        def step(self, action: Action) -> bool:
            return True

    with pytest.raises(DeuxError, match="Scene room has no viewpoints: the robot finds no room on floor 0"):
        collect_viewpoints([plan_viewpoints(tmp_path / "data", ToyScene(), 0, 2)], Cell)


def test_a_floor_without_a_free_place_is_an_error(tmp_path: Path) -> None:
    class Blocked(ToySimulator):
        def free_space(self, floor: int = 0) -> FreeSpace:
            space = super().free_space(floor)
            return replace(space, free=np.zeros_like(space.free))

    with pytest.raises(DeuxError, match="Scene room has no viewpoints: there is no free floor"):
        collect_viewpoints([plan_viewpoints(tmp_path / "data", ToyScene(), 0, 2, floor=1)], Blocked)


def test_more_viewpoints_than_free_cells(tmp_path: Path) -> None:
    class Narrow(ToySimulator):
        def free_space(self, floor: int = 0) -> FreeSpace:
            space = super().free_space(floor)
            free = np.zeros_like(space.free)
            free[18:24, 28:30] = True
            return replace(space, free=free)

    collect_viewpoints([plan_viewpoints(tmp_path / "data", ToyScene(), 0, 20)], Narrow)
    assert len(poses(tmp_path)) == 20


def test_viewpoints_lie_on_their_floor(tmp_path: Path) -> None:
    collect_viewpoints([plan_viewpoints(tmp_path / "data", ToyScene(), 0, 3, floor=1)], ToySimulator)
    assert (poses(tmp_path)[..., 1, 3] == 3.0 + ROBOT.camera_height).all()


def test_an_empty_floor_is_an_error_and_a_tiny_one_serves_all_viewpoints(tmp_path: Path) -> None:
    class Patch(ToySimulator):
        cells = 0

        def free_space(self, floor: int = 0) -> FreeSpace:
            space = super().free_space(floor)
            free = np.zeros_like(space.free)
            free.reshape(-1)[20 * 60 + 30 : 20 * 60 + 30 + self.cells] = True
            return replace(space, free=free)

    with pytest.raises(DeuxError, match=r"^Scene room has no viewpoints: there is no free floor: .*\.$"):
        collect_viewpoints([plan_viewpoints(tmp_path / "data", ToyScene(), 0, 2)], Patch)
    Patch.cells = 8  # 0.8 m x 0.1 m: room for a step along it, and fewer cells than viewpoints
    collect_viewpoints([plan_viewpoints(tmp_path / "data", ToyScene(), 0, 10)], Patch)
    assert poses(tmp_path).shape == (10, 3, 4, 4)


def test_ideal_viewpoints_have_two_source_frames_with_parallax(tmp_path: Path) -> None:
    """Distances and headings are computed here from the poses, not by the module that chose them."""
    collect_viewpoints([plan_viewpoints(tmp_path / "data", ToyScene(), 0, 12, ideal=True)], ToySimulator)
    found = poses(tmp_path)
    assert len(found) == 12
    for first, second, target in found:
        for source in (first, second):
            assert 0.15 <= np.linalg.norm(source[:3, 3] - target[:3, 3]) <= 0.8
            assert motion(source, target)[1] <= 40.0
        assert not np.allclose(first, second)


def test_ideal_sources_need_room_around_the_viewpoint(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    space = ToySimulator().free_space()
    free = np.zeros_like(space.free)
    free[tuple(np.argwhere(space.free)[0])] = True  # one cell, and no second camera 0.15 m away
    monkeypatch.setattr(ToySimulator, "free_space", lambda self, floor=0: replace(space, free=free))
    with pytest.raises(DeuxError, match="has no ideal viewpoints"):
        collect_viewpoints([plan_viewpoints(tmp_path / "data", ToyScene(), 0, 1, ideal=True)], ToySimulator)
