import numpy as np
import pytest
from scan_scenes import CHAIR, label_at, room, write_replica

from deux.contracts import SceneSource
from deux.errors import DeuxError
from deux.scenes.objects import find_objects
from deux.testing.scenes import SceneSourceSuite
from deux_plugins.scenes.replica import SPLIT_NAMES, Replica


@pytest.fixture
def root(tmp_path):
    """One scene of each split."""
    for size, name in enumerate(("room_0", "hotel_0", "room_2"), start=4):
        write_replica(tmp_path / "replica_v1", name, room(size))
    return tmp_path


def only(root, **options):
    """The locator of one scene."""
    (reference,) = Replica(str(root), train=["room_0"], validation=0, test=0, **options).splits().train
    return reference


class TestReplica(SceneSourceSuite):
    @pytest.fixture(autouse=True)
    def _root(self, root):
        self.root = root

    def make_source(self) -> SceneSource:
        return Replica(str(self.root), train=["room_0"], test=["room_2"])


def test_the_splits_hold_each_of_the_18_scenes_once():
    everything = [name for names in SPLIT_NAMES.values() for name in names]
    assert sorted(everything) == sorted(
        [f"apartment_{k}" for k in range(3)]
        + [f"frl_apartment_{k}" for k in range(6)]
        + [f"office_{k}" for k in range(5)]
        + [f"room_{k}" for k in range(3)]
        + ["hotel_0"]
    )


def test_a_scene_has_its_vertices_colours_and_its_labels(root):
    mesh = only(root).load().mesh
    np.testing.assert_allclose(mesh.bounds, [[0, 0, -3], [4, 2.5, 0]])
    assert (mesh.vertex_colors == (90, 120, 150)).all()
    assert len(mesh.faces) == 24, "each quad is two triangles"
    found = [label_at(mesh, *place) for place in [(3, 1, 0.9), (1, 1, 0), (0, 1.5, 1), (2, 1.5, 2.5)]]
    assert found == ["chair", "floor", "wall", "ceiling"]
    assert find_objects(mesh).labels == ("chair",)
    assert set(np.unique(mesh.face_object)) <= {11, 12, 13, 11 + CHAIR}


def test_a_damaged_list_of_objects_is_reported(root):
    (root / "replica_v1" / "room_0" / "habitat" / "info_semantic.json").write_text('{"objects": [{"id": 1}]}')
    with pytest.raises(DeuxError, match=r"does not list objects.*scenes\.labels=false"):
        only(root).load()
    assert (only(root, labels=False).load().mesh.face_label == -1).all()


def test_missing_scenes_are_reported(root):
    with pytest.raises(DeuxError, match=r"12 of the 13 scenes of scenes\.train are missing.* first apartment_0"):
        Replica(str(root)).splits()
