"""What names a dataset, where a plugin has a part in it."""

from dataclasses import dataclass, replace

import pytest
from toy_world import SIMULATION, ToyScene, Wanderer

from deux.collection.specification import DatasetSpec, fingerprint_of
from deux.contracts import SceneReference, SceneSplits
from deux.errors import DeuxError
from deux.scenes.splits import check_apart


@dataclass(frozen=True)
class Numbered(SceneReference):
    @property
    def identity(self):
        return 7


def test_the_scene_is_named_for_an_identity_that_is_no_text():
    spec = DatasetSpec("d", (ToyScene(),), "wanderer", SIMULATION, steps=3)
    assert spec.key()
    sentence = r"^the `identity` of the scene seven \(Numbered of .*test_specification\) gives a value of the type int"
    with pytest.raises(DeuxError, match=sentence):
        replace(spec, scenes=(Numbered("seven"),)).key()
    with pytest.raises(DeuxError, match=sentence):
        check_apart(SceneSplits((Numbered("seven"),), (), ()))


def test_remembered_frames_are_part_of_the_hash_unless_there_are_none():
    """Datasets from before the option have no such entry, and were collected as with 0."""
    spec = DatasetSpec("d", (ToyScene(),), "wanderer", SIMULATION, steps=3, correct_depth=True)
    assert "remembered_frames" not in spec.description()
    assert len({replace(spec, remembered_frames=frames).key() for frames in (0, 10, 30)}) == 3


@pytest.mark.parametrize("found", [7, b"hash", ("a",)])
def test_the_explorer_is_named_for_a_fingerprint_that_is_no_text(found):
    class Marked(Wanderer):
        def fingerprint(self):
            return found

    assert fingerprint_of(Wanderer()) is None
    sentence = r"^the `fingerprint` of the explorer Marked gives a value of the type \w+: it must be text"
    with pytest.raises(DeuxError, match=sentence):
        fingerprint_of(Marked())
