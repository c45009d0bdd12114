import json
from dataclasses import replace

import numpy as np
import pytest
from box_scenes import CAMERA, SCENES, BoxRoomSimulator, FarModel, box_simulation, explorer, measure
from toy_world import run_travelled

from deux.collection.jobs import run_here
from deux.collection.local_execution import LocalExecutor
from deux.collection.perception import Perception
from deux.collection.specification import episode_seed
from deux.collection.walk import Walk, run_walks
from deux.contracts import Robot, SceneArea
from deux.errors import DeuxError
from deux.geometry.camera import Camera
from deux.registry import registry
from deux.simulator.simulation import Simulation
from deux.studies.comparison_episodes import compare_explorers

EXPLORERS = [explorer("random"), explorer("frontier")]


@pytest.fixture
def compare():
    """compare(folder, **changes): both explorers in both scenes, eight steps, one reward."""
    with box_simulation() as simulation:

        def run(folder, **changes):
            given = {"scenes": SCENES, "explorers": EXPLORERS, "rewards": {"coverage": {}}, "seed": 3, "steps": 8}
            found = compare_explorers(folder, simulation, **(given | changes))
            assert found.failed == {}
            return found.episodes

        yield run


def numbers(episodes):
    """The episodes without the time that they took."""
    return [{name: value for name, value in vars(episode).items() if name != "seconds"} for episode in episodes]


def test_every_explorer_in_every_scene_from_the_same_places(compare, tmp_path):
    episodes = compare(tmp_path, episodes=2)
    assert [(e.explorer, e.scene, e.episode) for e in episodes] == [
        (name, scene, number) for name in ("random", "frontier") for scene in ("short", "long") for number in (0, 1)
    ]
    assert len({(e.scene, e.episode, e.seed, e.trajectory[0]) for e in episodes}) == 4
    assert {e.seed for e in episodes} == {episode_seed(3, scene, number) for scene in SCENES for number in (0, 1)}
    assert all(len(e.trajectory) == 8 for e in episodes)
    assert BoxRoomSimulator.loaded == ["short", "long"]  # once, whoever walks there


def test_every_floor_has_episodes_where_all_are_asked_for(compare, tmp_path, two_floors):
    scenes = (replace(SCENES[0], area=SceneArea(floor="all")), SCENES[1])
    episodes = compare(tmp_path, scenes=scenes, explorers=EXPLORERS[:1])
    assert [(e.scene, e.floor) for e in episodes] == [("short", 0), ("short", 1), ("long", 0)]
    assert sorted(str(path.parent.relative_to(tmp_path)) for path in tmp_path.rglob("episode.json")) == [
        "random-long-00",
        "random-short-00",
        "random-short-floor1-00",
    ]
    BoxRoomSimulator.loaded.clear()
    assert numbers(compare(tmp_path, scenes=scenes, explorers=EXPLORERS[:1])) == numbers(episodes)
    assert BoxRoomSimulator.loaded == []  # not to count its floors either


def test_a_trajectory_is_where_the_explorer_walks(compare, tmp_path):
    episode = compare(tmp_path, explorers=EXPLORERS[1:])[1]
    with_frames = Walk(BoxRoomSimulator(SCENES[1], CAMERA, Robot(), True), EXPLORERS[1].create(), episode.seed, 8)
    poses = np.array([step.frame.pose for (step,) in run_walks([with_frames])])
    np.testing.assert_array_equal(np.array(episode.trajectory)[:, :2], poses[:, [0, 2], 3])
    moved = np.hypot(*np.diff(poses[:, [0, 2], 3], axis=0).T).sum()
    assert episode.exploration.path_length == pytest.approx(moved)


def test_only_what_is_missing_is_run(compare, tmp_path):
    told = []
    whole = compare(tmp_path, progress=lambda stage, done, total: told.append((stage, done, total)))
    assert (told[0], told[-1]) == (("episodes", 0, 4), ("episodes", 4, 4))
    (tmp_path / "frontier-long-00/episode.json").unlink()
    kept = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*.json")}
    BoxRoomSimulator.loaded.clear()
    assert numbers(compare(tmp_path)) == numbers(whole)
    assert BoxRoomSimulator.loaded == ["long"]
    assert {path: path.stat().st_mtime_ns for path in kept} == kept


class Faulty(registry().get("explorers", "random")):
    """Fails at its fourth step as long as `broken` is true."""

    broken = True

    def act(self, observation):
        if self.broken and observation.step == 3:
            raise ValueError("no way out")
        return super().act(observation)


def test_an_explorer_that_fails_costs_the_others_nothing(tmp_path, monkeypatch):
    registry().register("explorers", "faulty", Faulty)
    given = {"explorers": [explorer("faulty"), EXPLORERS[1]], "rewards": {"coverage": {}}, "seed": 3, "steps": 8}
    try:
        with box_simulation() as simulation:
            found = compare_explorers(tmp_path, simulation, SCENES, **given)
            monkeypatch.setattr(Faulty, "broken", False)
            mended = compare_explorers(tmp_path, simulation, SCENES, **given)
    finally:
        registry().unregister("explorers", "faulty")
    assert [(e.explorer, e.scene) for e in found.episodes] == [("frontier", "short"), ("frontier", "long")]
    assert found.failed == {"faulty": [tmp_path / f"faulty-{scene}-00/failure.txt" for scene in ("short", "long")]}
    assert found.failed["faulty"][0].read_text().endswith("\nValueError: no way out\n")
    assert [e.explorer for e in mended.episodes] == ["faulty"] * 2 + ["frontier"] * 2
    assert (mended.episodes[2:], mended.failed) == (found.episodes, {})


def test_a_guided_explorer_sees_each_frame_once(compare, tmp_path):
    model = FarModel()
    perception = Perception(model, uncertainty=measure("l1").create())
    compare(tmp_path, explorers=[explorer("deux"), explorer("random")], perception=perception)
    assert len(model.frames) == 2 * 8  # and none of the random explorer's
    with pytest.raises(DeuxError, match="there is no depth model"):
        compare(tmp_path / "without", explorers=[explorer("deux")])


def test_a_damaged_episode_is_named(compare, tmp_path):
    compare(tmp_path)
    (tmp_path / "random-short-00/episode.json").write_text(json.dumps({"explorer": "random"}))
    with pytest.raises(DeuxError, match=r"random-short-00/episode\.json is damaged, it is not an episode"):
        compare(tmp_path)


@pytest.mark.parametrize("several", [run_travelled, pytest.param(LocalExecutor(2), marks=pytest.mark.slow)])
def test_processes_change_nothing(tmp_path, several):
    simulation = Simulation(Camera(32, 32), Robot(), registry().choose("simulators", {"name": "mesh"}))
    scenes = registry().create("scenes", "apartments", {"test": 2}).splits().test
    explorers = [explorer("deux"), explorer("random")]
    told = []
    alone, shared = (
        compare_explorers(
            tmp_path / name,
            simulation,
            scenes,
            explorers,
            {"novelty": {}},
            seed=1,
            steps=5,
            perception=Perception(FarModel(), uncertainty=measure("l1").create()),
            execute=execute,
            progress=lambda stage, done, total: told.append((done, total)),
        )
        for name, execute in {"alone": run_here, "shared": several}.items()
    )
    assert numbers(alone.episodes) == numbers(shared.episodes)
    assert told == [(done, 4) for done in range(5)] * 2
