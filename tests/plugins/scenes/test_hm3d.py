import numpy as np
import pytest
import trimesh
from scan_scenes import COLORS, label_at, room, write_hm3d, write_textured

from deux.contracts import SceneSource
from deux.errors import DeuxError
from deux.options import construct
from deux.scenes.objects import find_objects
from deux.testing.scenes import SceneSourceSuite
from deux_plugins.scenes.hm3d import HM3D, read_instances

TRAIN, SECOND, FIRST_VAL, VAL = (f"{k:05d}-abcdefgh{k % 1000:03d}" for k in (0, 1, 800, 810))


@pytest.fixture
def root(tmp_path):
    """Two buildings to train on, minival's first one, which is in val too, and one that is in val alone."""
    for size, (split, name) in enumerate([("train", TRAIN), ("train", SECOND), ("minival", FIRST_VAL), ("val", VAL)]):
        write_hm3d(tmp_path / "hm3d" / split, name, room(4 + size), labels=name != SECOND)
    write_hm3d(tmp_path / "hm3d" / "val", FIRST_VAL, room(6))
    return tmp_path


def names(scenes):
    return [scene.name for scene in scenes]


def only(root, name=TRAIN, **options):
    """The locator of one building."""
    (reference,) = HM3D(str(root), train=[name], validation=0, test=0, **options).splits().train
    return reference


def with_basis_textures(root, name):
    """Make a building's mesh one with Basis textures, by what its header and its image say; the rest is no such one."""
    folder = root / "hm3d" / "train" / name
    basis = (folder / f"{name[6:]}.glb").rename(folder / f"{name[6:]}.basis.glb")
    content = basis.read_bytes()
    end = 20 + int.from_bytes(content[12:16], "little")
    header = content[20:end].replace(b"image/png", b"image/ktx2").rstrip().ljust(end - 20 + 4)
    lengths = (len(content) + 4).to_bytes(4, "little") + len(header).to_bytes(4, "little")
    image = content[end:].replace(b"\x89PNG\r\n\x1a\n\0\0\0\r", b"\xabKTX 20\xbb\r\n\x1a\n")
    basis.write_bytes(content[:8] + lengths + content[16:20] + header + image)
    return basis


class TestHM3D(SceneSourceSuite):
    @pytest.fixture(autouse=True)
    def _root(self, root):
        self.root = root

    def make_source(self) -> SceneSource:
        return HM3D(str(self.root), validation=["00800"], test=["00810"], limit=2)


def test_the_splits_are_the_papers(tmp_path):
    folder = tmp_path / "hm3d"
    for split, indices in (("train", range(800)), ("val", range(800, 900)), ("minival", range(800, 810))):
        for index in indices:
            (folder / split / f"{index:05d}-abcdefgh{index % 1000:03d}").mkdir(parents=True)
    inventory = HM3D(str(folder)).inventory()
    assert [len(scenes) for scenes in inventory.values()] == [800, 10, 100]
    minival = {scene.name for scene in inventory["validation"]}
    assert minival == {scene.name for scene in inventory["test"][:10]}


def test_what_validates_is_left_out_of_the_test(root):
    limited = HM3D(str(root), train=1, validation=1, test=None, limit=1)
    with pytest.raises(DeuxError, match=r"1 of the 1 scenes of scenes\.test .* first 00801"):
        limited.splits()
    splits = HM3D(str(root), train=1, validation=0, test=1).splits()
    assert (names(splits.train), names(splits.test)) == ([TRAIN], [FIRST_VAL])
    with pytest.raises(DeuxError, match=r"scenes\.test is 100, but HM3D has only 90 scenes"):
        HM3D(str(root), train=0, validation=10, test=100).splits()


@pytest.mark.parametrize("name", ["00810", VAL[6:], VAL])
def test_a_building_is_called_by_index_or_id(root, name):
    assert only(root, name).name == VAL


def test_labels_are_the_instances_categories(root):
    mesh = only(root).load().mesh
    assert mesh.label_names == ("chair, dining", "floor", "wall")
    assert label_at(mesh, 3, 1, 0.9) == "chair, dining"
    assert label_at(mesh, 1, 1, 0) == "floor"
    assert label_at(mesh, 0, 1.5, 1) == "wall"
    assert label_at(mesh, 2, 1.5, 2.5) is None, "the ceiling's colour is in no line"
    assert set(np.unique(mesh.face_object)) == {-1, 1, 2, 7}
    assert find_objects(mesh).labels == ("chair, dining",)
    assert (only(root, SECOND).load().mesh.face_label == -1).all()


def test_labels_may_be_colours_of_vertices(root):
    folder = root / "hm3d" / "train" / TRAIN
    made = room()
    path = folder / f"{TRAIN[6:]}.semantic.glb"
    vertices = made.vertices[made.faces].reshape(-1, 3)
    colors = np.repeat((255 - COLORS)[made.kind], 3, axis=0)
    faces = np.arange(len(vertices)).reshape(-1, 3)
    trimesh.Trimesh(vertices, faces, vertex_colors=colors, process=False).export(path)
    mesh = only(root).load().mesh
    assert label_at(mesh, 3, 1, 0.9) == "chair, dining"
    assert label_at(mesh, 0, 1.5, 1) == "wall"


def test_the_basis_file_is_for_simulators_that_read_it(root):
    folder = root / "hm3d" / "train" / TRAIN
    plain = folder / f"{TRAIN[6:]}.glb"
    assert only(root).file == plain
    write_textured(folder / f"{TRAIN[6:]}.basis.glb", room())
    assert only(root).path == plain
    assert only(root).file == folder / f"{TRAIN[6:]}.basis.glb"


def test_basis_textures_name_the_other_archive(root):
    basis = with_basis_textures(root, TRAIN)
    reference = only(root)
    assert reference.file == basis
    assert reference.identity
    with pytest.raises(DeuxError, match=r"-glb in their names contain abcdefgh000\.glb") as error:
        reference.load()
    assert "\n" not in str(error.value)


def test_the_inventory_tells_what_is_there(root):
    inventory = HM3D(str(root)).inventory()
    first, second, third = inventory["train"][:3]
    assert (first.name, first.missing, first.without) == (TRAIN, (), ())
    assert second.without == (f"labels ({SECOND[6:]}.semantic.txt and {SECOND[6:]}.semantic.glb)",)
    assert third.name == "00002"
    assert third.missing
    assert sum(not scene.missing for scene in inventory["test"]) == 2


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"train": 3}, r"1 of the 3 scenes of scenes\.train are missing or incomplete, first 00002"),
        ({"train": ["00999"]}, "lists 00999, which is not a scene of HM3D"),
        ({"train": ["00800"], "validation": ["00800"]}, f"scene {FIRST_VAL} is in scenes.train and scenes.validation"),
    ],
)
def test_mistakes_are_one_sentence(root, settings, message):
    with pytest.raises(DeuxError, match=message) as error:
        construct(HM3D, {"root": str(root), "validation": 0, "test": 0, **settings}, "scenes").splits()
    assert "\n" not in str(error.value)


def test_the_folder_of_a_split_is_the_wrong_level(root):
    with pytest.raises(DeuxError, match=r"wrong level: .*/hm3d looks like HM3D's folder"):
        HM3D(str(root / "hm3d" / "train")).splits()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("id,color\n", "begins with 'id,color'"),
        ("HM3D Semantic Annotations\n1,FF0000\n", "line 2 of .* is not id,HEXRGB"),
        ("HM3D Semantic Annotations\n1,red,wall,0\n", "line 2 of .* is not id,HEXRGB"),
    ],
)
def test_a_damaged_list_of_instances_is_reported(tmp_path, text, message):
    path = tmp_path / "a.semantic.txt"
    path.write_text(text)
    with pytest.raises(DeuxError, match=message):
        read_instances(path)
