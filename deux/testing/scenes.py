"""Conformance suite for scene sources: tests of the contract of `deux.contracts.SceneSource`.

A plugin's test file subclasses it, and pytest runs the whole suite:

    class TestMyScenes(SceneSourceSuite):
        def make_source(self) -> SceneSource:
            return MyScenes(train=2, validation=1, test=1)

Choose options with few scenes, but at least one for training and one for testing; one of each split is loaded.
"""

import os
import pickle
import subprocess
import sys
from collections import Counter
from typing import ClassVar

import numpy as np
import pytest

from deux.contracts import Robot, Scene, SceneArea, SceneReference, SceneSource, SceneSplits
from deux.errors import DeuxError
from deux.geometry.camera import Camera
from deux.scenes.loaded_scene import check_scene
from deux.scenes.splits import splits_of
from deux.simulator.mesh_simulator import MeshSimulator


def references(splits: SceneSplits) -> list[SceneReference]:
    """References of all scenes of all splits."""
    return [*splits.train, *splits.validation, *splits.test]


class SceneSourceSuite:
    """Base class of the tests of a scene source. Subclasses define `make_source`.

    Set `needs_simulator` to True for scenes that have neither a file nor a mesh, since a specific simulator creates
    them from the reference.
    """

    needs_simulator: ClassVar[bool] = False

    def make_source(self) -> SceneSource:
        """Create the source to test, with a few scenes."""
        raise NotImplementedError

    def test_splits_hold_references(self) -> None:
        """Splits are tuples of `SceneReference`, and those for training and testing are not empty."""
        splits = splits_of(self.make_source())
        for scene in references(splits):
            assert isinstance(scene.area, SceneArea), f"the area of {scene.name} is {scene.area!r}, not a SceneArea"
        assert splits.train, "there is no scene to explore"
        assert splits.test, "there is no scene to test on"

    def test_no_scene_is_there_twice(self) -> None:
        """Names and identities are unique within and across splits."""
        scenes = references(self.make_source().splits())
        for noun, values in (("name", [s.name for s in scenes]), ("identity", [s.identity for s in scenes])):
            value, count = Counter(values).most_common(1)[0]
            assert count == 1, f"{count} scenes have the {noun} {value}"

    def test_equal_options_give_equal_splits(self) -> None:
        """Two sources with equal options have equal references with equal identities."""
        first, second = self.make_source().splits(), self.make_source().splits()
        assert first == second
        assert [s.identity for s in references(first)] == [s.identity for s in references(second)]

    def test_references_are_values(self) -> None:
        """References can be pickled; the copy has the same value, hash and identity."""
        for scene in references(self.make_source().splits()):
            copy = pickle.loads(pickle.dumps(scene))
            assert copy == scene, f"{scene.name} is another one after pickling"
            assert {scene: True}[copy], f"{scene.name} has another hash after pickling"
            assert copy.identity == scene.identity

    def test_identities_are_the_same_in_other_processes(self) -> None:
        """Another process computes the same identity from a reference, since datasets are found by it.

        Python's `hash` of text, for example, differs between processes.
        """
        scenes = references(self.make_source().splits())
        code = "import pickle, sys; print(*(scene.identity for scene in pickle.load(sys.stdin.buffer)), sep=chr(0))"
        path = os.pathsep.join(path for path in sys.path if path)  # with the folders that pytest added
        found = subprocess.run(
            [sys.executable, "-c", code],
            input=pickle.dumps(scenes),
            capture_output=True,
            env={**os.environ, "PYTHONPATH": path, "PYTHONHASHSEED": "1"},
            check=False,
        )
        assert found.returncode == 0, f"another process cannot read the references:\n{found.stderr.decode()}"
        assert found.stdout.decode().rstrip().split("\0") == [scene.identity for scene in scenes], (
            "another process computes other identities: use nothing that differs between processes, such as `hash`"
        )

    def test_references_are_small(self) -> None:
        """A pickled reference is smaller than 10 kB: it does not contain the mesh."""
        for scene in references(self.make_source().splits()):
            assert len(pickle.dumps(scene)) < 10_000, f"{scene.name} takes its mesh along"

    def test_identities_tell_no_place(self) -> None:
        """The identity of a scene does not contain its path, which differs between machines."""
        for scene in references(self.make_source().splits()):
            assert scene.identity
            assert not scene.identity.startswith("/")
            if scene.file is not None:
                assert str(scene.file.parent) not in scene.identity, f"the identity of {scene.name} holds its path"

    def test_scenes_can_be_had(self) -> None:
        """The first scene of each split has a file or can be loaded, unless `needs_simulator` is True.

        Loaded scenes have a valid mesh and valid floors.
        """
        splits = self.make_source().splits()
        for reference in (scenes[0] for scenes in (splits.train, splits.validation, splits.test) if scenes):
            if reference.file is not None:
                assert reference.file.is_absolute()
                assert reference.file.is_file(), f"the file of {reference.name} is not there"
            try:
                scene = reference.load()
            except DeuxError:
                known = reference.file is not None or self.needs_simulator
                assert known, f"{reference.name} is in no file, and cannot be loaded (`needs_simulator`)"
                continue
            assert (scene.name, scene.identity) == (reference.name, reference.identity)
            check_scene(scene, f"the scene {reference.name}")
            _check_floors(scene)

    def test_a_scene_is_the_same_each_time(self) -> None:
        """Loading a scene twice returns equal arrays."""
        reference = self.make_source().splits().train[0]
        try:
            first, second = reference.load(), reference.load()
        except DeuxError:
            pytest.skip("there is no mesh of the scene")
        assert first.floors == second.floors
        for name in ("vertices", "faces", "uv", "face_material", "face_label", "vertex_colors", "face_object"):
            np.testing.assert_array_equal(getattr(first.mesh, name), getattr(second.mesh, name), err_msg=name)
        for one, other in zip(first.mesh.materials, second.mesh.materials, strict=True):
            assert (one.name, one.color) == (other.name, other.color)
            np.testing.assert_array_equal(one.texture, other.texture, err_msg=f"texture of {one.name}")

    def test_the_robot_has_room(self) -> None:
        """In the first training scene, the default robot has at least 1 m² of free floor, if there is a mesh."""
        reference = self.make_source().splits().train[0]
        try:
            reference.load()
        except DeuxError:
            pytest.skip("there is no mesh of the scene")
        try:
            area = MeshSimulator(reference, Camera(16, 16), Robot(), colors=False).free_space().area
        except DeuxError as error:
            raise AssertionError(f"no robot can be placed in {reference.name} (metres, y up?): {error}") from error
        assert area >= 1.0, f"the robot has {area:.2g} m² of free floor in {reference.name}: is it in metres, y up?"

    def test_further_scenes_are_others(self) -> None:
        """`further` returns the requested number of scenes without the excluded ones, or raises DeuxError."""
        source = self.make_source()
        without = {scene.identity for scene in references(source.splits())}
        try:
            first = source.further(2, without)
        except DeuxError:
            return
        second = source.further(3, without | {scene.identity for scene in first})
        assert (len(first), len(second), source.further(0, without)) == (2, 3, ())
        identities = [scene.identity for scene in (*first, *second)]
        assert len(set(identities)) == 5, f"a further scene is there twice: {identities}"
        assert len({scene.name for scene in (*first, *second)}) == 5
        assert not without & set(identities), "a further scene was to be avoided"


def _check_floors(scene: Scene) -> None:
    """Assert that all floors are within the mesh and differ in height."""
    low, high = scene.mesh.bounds[:, 1]
    heights = [floor.height for floor in scene.floors]
    assert len(set(heights)) == len(heights), f"{scene.name} lists a floor twice: {heights}"
    assert all(low - 0.05 <= height <= high for height in heights), f"a floor of {scene.name} is not in its mesh"
    assert all(floor.area > 0.0 for floor in scene.floors)
