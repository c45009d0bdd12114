import numpy as np
import pytest
from scan_scenes import CHAIR, COLORS, HOUSE, label_at, room, write_mp3d, write_original_mp3d, write_ply

from deux.contracts import Channel, Robot, SceneArea, SceneSource
from deux.errors import DeuxError
from deux.geometry.camera import Camera
from deux.options import construct
from deux.scenes.objects import find_objects
from deux.simulator.mesh_simulator import MeshSimulator
from deux.testing.scenes import SceneSourceSuite
from deux_plugins.scenes.mp3d import MP3D, MPCAT40, SPLIT_NAMES, read_house

TRAIN, OTHER, VALIDATION, TEST = "17DRP5sb8fy", "1LXtFkjw3qL", "2azQ1b91cZZ", "2t7WUuJeko7"


@pytest.fixture
def root(tmp_path):
    """The first building of each split, in Habitat-Sim's layout; the test building has no labels."""
    for size, name in enumerate((TRAIN, VALIDATION, TEST), start=4):
        write_mp3d(tmp_path / "mp3d", name, room(size), labels=name != TEST)
    return tmp_path


def names(scenes):
    return [scene.name for scene in scenes]


def only(root, name=TRAIN, **options):
    """The locator of one building."""
    (reference,) = MP3D(str(root), train=[name], validation=0, test=0, **options).splits().train
    return reference


class TestMP3D(SceneSourceSuite):
    @pytest.fixture(autouse=True)
    def _root(self, root):
        self.root = root

    def make_source(self) -> SceneSource:
        return MP3D(str(self.root), limit=1)


def test_the_splits_are_the_sets_own():
    everything = [name for names in SPLIT_NAMES.values() for name in names]
    assert [len(names) for names in SPLIT_NAMES.values()] == [61, 11, 18]
    assert len(set(everything)) == 90
    assert all(len(name) == 11 for name in everything)


def test_a_number_takes_the_first_buildings(root):
    splits = MP3D(str(root / "mp3d"), train=1, validation=[VALIDATION], test=0).splits()
    assert (names(splits.train), names(splits.validation), names(splits.test)) == ([TRAIN], [VALIDATION], [])


def test_a_building_is_turned_upright_and_keeps_its_colours(root):
    mesh = only(root).load().mesh
    np.testing.assert_allclose(mesh.bounds, [[0, 0, -3], [4, 2.5, 0]])
    (material,) = mesh.materials
    assert (material.texture == COLORS).all()
    top = (mesh.triangles[..., 1] == np.float32(0.9)).all(axis=1)
    assert top.sum() == 2
    assert (mesh.uv[top][..., 0] == (CHAIR + 0.5) / len(COLORS)).all()


@pytest.mark.parametrize("write", [write_mp3d, write_original_mp3d])
def test_both_layouts_are_labelled_with_mpcat40(tmp_path, write):
    write(tmp_path / "v1" / "scans", TRAIN, room())
    mesh = only(tmp_path).load().mesh
    assert (mesh.label_names[3], mesh.label_names[17], len(mesh.label_names)) == ("chair", "ceiling", 42)
    found = [label_at(mesh, *place) for place in [(3, 1, 0.9), (1, 1, 0), (0, 1.5, 1), (2, 1.5, 2.5)]]
    assert found == ["chair", "floor", "wall", "ceiling"]
    assert find_objects(mesh).labels == ("chair",)
    assert (find_objects(mesh).face_object >= 0).sum() == (mesh.face_object == CHAIR).sum()


def test_the_robot_sees_labels_where_the_annotation_has_them(root):
    simulator = MeshSimulator(only(root), Camera(32, 32, hfov=110.0), Robot())
    simulator.reset(2.0, -1.0, -np.pi / 2)  # 0.8 m west of the chair, looking east
    frame = simulator.observe(frozenset({Channel.LABELS}))
    assert MPCAT40[frame.labels[30, 16]] == "chair"
    assert MPCAT40[frame.labels[0, 16]] == "ceiling"


def test_without_its_files_a_building_has_no_labels(root):
    for scene in (only(root, TEST).load(), only(root, labels=False).load()):
        assert (scene.mesh.face_label == -1).all()
        assert scene.mesh.face_object is None


def test_the_identity_is_of_the_content_with_the_labels(root, tmp_path):
    write_mp3d(tmp_path / "elsewhere", TRAIN, room(4))
    labelled = only(root)
    assert only(tmp_path / "elsewhere").identity == labelled.identity != only(root, labels=False).identity
    assert labelled.load().identity == labelled.identity


def test_a_prepared_building_keeps_its_labels(root, tmp_path):
    """Read, and opened again: equal labels, and textures no larger than asked for."""
    scenes = [only(root, max_texture=2, prepared=str(tmp_path / "prepared")).load() for _ in range(2)]
    assert any((tmp_path / "prepared").iterdir())
    for scene in scenes:
        assert label_at(scene.mesh, 3, 1, 0.9) == "chair"
        assert max(scene.mesh.materials[0].texture.shape[:2]) == 2
    assert scenes[0].identity == scenes[1].identity != only(root).identity


def test_an_annotation_of_another_building_is_reported(root, caplog):
    far = room()
    write_ply(root / "mp3d" / TRAIN / f"{TRAIN}_semantic.ply", far.vertices + 20, far.faces, object_id=far.kind)
    mesh = only(root).load().mesh
    assert (mesh.face_label == -1).all()
    assert "100 % of its faces are farther than 0.2 m" in caplog.text


def test_where_the_robot_lives_is_handed_on(root):
    options = {"root": str(root), "train": [TRAIN], "validation": 0, "test": 0, "floor": "all", "start": [1, 2]}
    (reference,) = construct(MP3D, options, "scenes").splits().train
    assert reference.area == SceneArea("all", None, (1.0, 2.0))


def test_the_inventory_lists_all_90_buildings(root):
    (root / "mp3d" / VALIDATION / f"{VALIDATION}.house").unlink()
    glb = root / "mp3d" / TEST / f"{TEST}.glb"
    glb.write_bytes(glb.read_bytes()[:-10])
    inventory = MP3D(str(root)).inventory()
    assert [len(scenes) for scenes in inventory.values()] == [61, 11, 18]
    complete = inventory["train"][0]
    assert (complete.name, len(complete.files), complete.missing, complete.without) == (TRAIN, 4, (), ())
    assert inventory["train"][1].missing == (f"there is no folder {root / 'mp3d' / OTHER}",)
    assert inventory["validation"][0].without == (f"labels ({VALIDATION}.house)",)
    (root / "mp3d" / OTHER).mkdir()
    again = MP3D(str(root)).inventory()["train"][1]
    assert again.missing == (f"there is no {OTHER}.glb in {root / 'mp3d' / OTHER}",)
    assert "is truncated after" in inventory["test"][0].missing[0]


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        (
            {},
            r"60 of the 61 scenes of scenes\.train are missing.*, first 1LXtFkjw3qL, there is no folder .*licence",
        ),
        ({"train": 62}, r"scenes\.train is 62, but Matterport3D has only 61 scenes"),
        ({"train": -1}, r"scenes\.train is -1"),
        ({"limit": 0}, r"scenes\.limit is 0"),
        ({"train": ["17DRP5sb8fx"]}, "not a scene of Matterport3D: did you mean 17DRP5sb8fy"),
        ({"train": [TRAIN], "test": [TRAIN]}, f"scene {TRAIN} is in scenes.train and scenes.test"),
        ({"train": [TRAIN, TRAIN], "validation": 0, "test": 0}, "list it once"),
        ({"train": "all"}, r"scenes\.train must be"),
        ({"floor": "top"}, r"scenes\.floor"),
        ({"region": [0, 1]}, r"scenes\.region"),
    ],
)
def test_mistakes_are_one_sentence(root, settings, message):
    with pytest.raises(DeuxError, match=message) as error:
        construct(MP3D, {"root": str(root), **settings}, "scenes").splits()
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("wrong", ["data/scene_datasets/mp3d/17DRP5sb8fy", "data", "."])
def test_the_root_may_be_at_the_wrong_level(tmp_path, wrong):
    write_mp3d(tmp_path / "data" / "scene_datasets" / "mp3d", TRAIN, room())
    with pytest.raises(DeuxError, match=r"wrong level: .*/scene_datasets/mp3d looks like Matterport3D's folder"):
        MP3D(str(tmp_path / wrong)).splits()


def test_a_root_that_is_not_there_is_reported(tmp_path):
    with pytest.raises(DeuxError, match="there is no such folder"):
        MP3D(str(tmp_path / "nowhere")).splits()


def test_a_folder_of_something_else_is_reported(tmp_path_factory):
    folder = tmp_path_factory.mktemp("other") / "a" / "b" / "c"
    folder.mkdir(parents=True)
    with pytest.raises(DeuxError, match=r"does not look like Matterport3D's folder: it contains <id>/<id>\.glb"):
        MP3D(str(folder)).splits()


def test_a_house_file_is_read(tmp_path):
    path = tmp_path / "a.house"
    path.write_text(HOUSE)
    house = read_house(path)
    assert house.category == {0: "floor", 1: "wall", 2: "ceiling", 3: "chair"}
    assert house.object_of_segment == {100: 0, 101: 1, 102: 2, 205: 3}


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "no categories or no objects"),
        (HOUSE.replace("C 0 4 floor 2 floor 0 0 0 0 0", "C 0 4"), "line 6 of .* is not a valid C line"),
        (HOUSE.replace("O 2 0 3", "O two 0 3"), "line 14 of .* is not a valid O line"),
    ],
)
def test_a_damaged_house_file_is_reported(root, text, message):
    (root / "mp3d" / TRAIN / f"{TRAIN}.house").write_text(text)
    with pytest.raises(DeuxError, match=message) as error:
        only(root).load()
    assert "scenes.labels=false" in str(error.value)


@pytest.mark.parametrize("numbers", [{}, {"object_idx": np.zeros(24)}])
def test_a_ply_without_objects_is_reported(root, numbers):
    made = room()
    write_ply(root / "mp3d" / TRAIN / f"{TRAIN}_semantic.ply", made.vertices, made.faces, **numbers)
    with pytest.raises(DeuxError, match="neither object_id nor material_id"):
        only(root).load()
