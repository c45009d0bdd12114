"""The floors of scenes: counted once, and only where episodes take place on all of them."""

from dataclasses import replace
from pathlib import Path

import pytest
from toy_world import ToyScene, ToySimulator

from deux.collection.floor_counts import count_all_floors
from deux.contracts import Floor, SceneArea
from deux.errors import DeuxError

TOWER, HUT, SHED = (
    replace(ToyScene(name), area=SceneArea(floor=floor)) for name, floor in (("tower", "all"), ("hut", "all"), ("s", 1))
)


def test_each_scene_is_loaded_once(tmp_path: Path) -> None:
    loaded: list[str] = []

    def make(scene: ToyScene) -> ToySimulator:
        loaded.append(scene.name)
        return ToySimulator(scene, floors=(Floor(0.0, 9.0),) * (5 if scene.name == "tower" else 1))

    told: list[tuple[str, int, int]] = []
    found = count_all_floors([TOWER, SHED, HUT], tmp_path, make, progress=lambda *report: told.append(report))
    assert found == {"tower": 5, "s": 1, "hut": 1}
    assert loaded == ["tower", "hut"]
    assert told == [("floors", 1, 2), ("floors", 2, 2)]
    assert count_all_floors([TOWER, SHED, HUT], tmp_path, make) == found
    assert loaded == ["tower", "hut"]


def test_what_was_counted_before_a_scene_failed_is_kept(tmp_path: Path) -> None:
    def make(scene: ToyScene) -> ToySimulator:
        if scene.name == "hut":
            raise DeuxError("hut is closed.")
        return ToySimulator(scene)

    with pytest.raises(DeuxError, match="hut is closed"):
        count_all_floors([TOWER, HUT], tmp_path, make)
    assert count_all_floors([TOWER, HUT], tmp_path, ToySimulator) == {"tower": 2, "hut": 2}
    assert count_all_floors([TOWER], tmp_path, make) == {"tower": 2}
