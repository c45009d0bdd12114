"""The suite must fail for sources that break the contract, each in the test that is meant for it."""

from dataclasses import dataclass, replace
from itertools import count
from pathlib import Path

import numpy as np
import pytest

from deux.contracts import Floor, Material, Scene, SceneMesh, SceneReference, SceneSource, SceneSplits
from deux.errors import DeuxError
from deux.testing.scenes import SceneSourceSuite

CALLS = count()

SIDE = 3.0
"""Side of the floor in metres."""


@dataclass(frozen=True)
class Square(SceneReference):
    """A square floor, with one thing wrong; the name says which square it is."""

    fault: str

    @property
    def identity(self) -> str:
        if self.fault == "identity by chance":
            return f"square:{next(CALLS)}"
        if self.fault == "identity by hash":
            return f"square:{hash(self.name)}"
        return "square" if self.fault == "one identity" else f"square:{self.name}"

    @property
    def file(self) -> Path | None:
        return Path("nowhere.glb") if self.fault == "missing file" else None

    def __reduce__(self):
        name = f"{self.name} again" if self.fault == "changed by pickling" else self.name
        padding = b"x" * (20_000 if self.fault == "large" else 0)
        return _make, (name, self.fault, padding)

    def load(self) -> Scene:
        if self.fault == "cannot be loaded":
            raise DeuxError("there is no mesh.")
        corners = SIDE * np.array([[0, 0, 0], [1, 0, 0], [1, 0, 1], [0, 0, 1]], np.float32)
        corners *= {"millimetres": 1000.0, "no room": 0.1}.get(self.fault, 1.0)
        if self.fault == "another mesh each time":
            corners += np.float32(next(CALLS))
        mesh = SceneMesh(
            vertices=corners,
            faces=np.array([[0, 1, 2], [0, 2, 4 if self.fault == "broken faces" else 3]], np.int32),
            uv=np.zeros((2, 3, 2), np.float32),
            face_material=np.zeros(2, np.int32),
            materials=(Material("grey"),),
            face_label=np.full(2, -1, np.int32),
        )
        floors = {"no floor": (), "floor in the air": (Floor(3.0, 9.0),)}.get(self.fault, (Floor(corners[0, 1], 9.0),))
        return Scene("square" if self.fault == "other name" else self.name, mesh, floors, self.identity)


def _make(name: str, fault: str, padding: bytes) -> Square:
    return Square(name, fault)


class Squares(SceneSource):
    def __init__(self, fault: str) -> None:
        self.fault = fault

    def splits(self) -> SceneSplits:
        names = "abcc" if self.fault == "one scene twice" else "abcd"
        first, second, third, fourth = (Square(name, self.fault) for name in names)
        if self.fault == "other splits each time":
            first = replace(first, name=f"a{next(CALLS)}")
        return SceneSplits((first, second), (third,), () if self.fault == "nothing to test on" else (fourth,))

    def further(self, count, without):
        if self.fault == "nothing further":
            return super().further(count, without)
        names = [f"further{index}" for index in range(20)]
        if self.fault == "further scenes of the splits":
            names = ["a", *names]
        if self.fault == "too few further scenes":
            names = names[:3]
        known = set() if self.fault.startswith("further") else set(without)
        return tuple(s for s in (Square(name, self.fault) for name in names) if s.identity not in known)[:count]


def run(fault, test):
    suite = SceneSourceSuite()
    suite.make_source = lambda: Squares(fault)
    getattr(suite, test)()


TESTS = [name for name in dir(SceneSourceSuite) if name.startswith("test_")]


@pytest.mark.parametrize("fault", ["none", "nothing further"])
@pytest.mark.parametrize("test", TESTS)
def test_a_sound_source_passes(fault, test):
    run(fault, test)


@pytest.mark.parametrize(
    ("fault", "test"),
    [
        ("nothing to test on", "test_splits_hold_references"),
        ("one scene twice", "test_no_scene_is_there_twice"),
        ("one identity", "test_no_scene_is_there_twice"),
        ("other splits each time", "test_equal_options_give_equal_splits"),
        ("identity by chance", "test_equal_options_give_equal_splits"),
        ("changed by pickling", "test_references_are_values"),
        ("large", "test_references_are_small"),
        ("identity by hash", "test_identities_are_the_same_in_other_processes"),
        ("millimetres", "test_the_robot_has_room"),
        ("no room", "test_the_robot_has_room"),
        ("missing file", "test_scenes_can_be_had"),
        ("cannot be loaded", "test_scenes_can_be_had"),
        ("other name", "test_scenes_can_be_had"),
        ("broken faces", "test_scenes_can_be_had"),
        ("no floor", "test_scenes_can_be_had"),
        ("floor in the air", "test_scenes_can_be_had"),
        ("another mesh each time", "test_a_scene_is_the_same_each_time"),
        ("further scenes of the splits", "test_further_scenes_are_others"),
        ("too few further scenes", "test_further_scenes_are_others"),
    ],
)
def test_a_broken_source_fails(fault, test):
    with pytest.raises((AssertionError, DeuxError)):
        run(fault, test)


def test_a_path_in_an_identity_is_found(tmp_path):
    @dataclass(frozen=True)
    class Named(SceneReference):
        @property
        def identity(self) -> str:
            return f"file:{tmp_path / self.name}"

        @property
        def file(self) -> Path:
            return tmp_path / self.name

    class Source(SceneSource):
        def splits(self) -> SceneSplits:
            return SceneSplits((Named("a"),), (), (Named("b"),))

    suite = SceneSourceSuite()
    suite.make_source = Source
    with pytest.raises(AssertionError, match="holds its path"):
        suite.test_identities_tell_no_place()


def test_scenes_that_a_simulator_of_their_own_makes_pass():
    skipped = ("test_a_scene_is_the_same_each_time", "test_the_robot_has_room")  # by themselves
    for test in TESTS:
        if test not in (*skipped, "test_identities_are_the_same_in_other_processes"):  # which is slow
            suite = SceneSourceSuite()
            suite.needs_simulator = True
            suite.make_source = lambda: Squares("cannot be loaded")
            getattr(suite, test)()


def test_the_simulator_of_a_scene_without_a_mesh_is_named_in_the_error():
    @dataclass(frozen=True)
    class Meshless(SceneReference):
        kept: Path | None = None
        identity = "meshless"
        file = property(lambda self: self.kept)

    with pytest.raises(DeuxError, match="a simulator that makes it by itself"):
        Meshless("a").load()
    with pytest.raises(DeuxError, match="a simulator that reads its file"):
        Meshless("a", Path("a.glb")).load()
