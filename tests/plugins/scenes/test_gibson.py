import pytest
from scan_scenes import room, write_textured

from deux.contracts import SceneSource
from deux.errors import DeuxError
from deux.options import construct
from deux.testing.scenes import SceneSourceSuite
from deux_plugins.scenes.gibson import Gibson

BUILDINGS = ("Adrian", "Bolton", "Cantwell", "Denmark")


@pytest.fixture
def root(tmp_path):
    """Four buildings and the list of three of them and a fifth."""
    for size, name in enumerate(BUILDINGS, start=4):
        write_textured(tmp_path / "gibson" / f"{name}.glb", room(size))
    rows = ["id,train,val,test", "Adrian,1,0,0", "Bolton,0,1,0", "Cantwell,0,0,1", "Elsewhere,1,0,0"]
    (tmp_path / "split.csv").write_text("\n".join(rows) + "\n")
    return tmp_path


def names(splits):
    return [[scene.name for scene in scenes] for scenes in (splits.train, splits.validation, splits.test)]


class TestGibson(SceneSourceSuite):
    @pytest.fixture(autouse=True)
    def _root(self, root):
        self.root = root

    def make_source(self) -> SceneSource:
        return Gibson(str(self.root))


def test_without_a_list_the_split_is_drawn_and_logged(root, caplog):
    drawn = names(Gibson(str(root)).splits())
    assert [len(split) for split in drawn] == [2, 1, 1]
    assert sorted(name for split in drawn for name in split) == list(BUILDINGS)
    assert "split at random by scenes.split_seed=0" in caplog.text
    assert any(names(Gibson(str(root), split_seed=seed).splits()) != drawn for seed in range(1, 4))


def test_a_list_sets_the_splits(root):
    source = Gibson(str(root), train=1, split_file=str(root / "split.csv"))
    assert names(source.splits()) == [["Adrian"], ["Bolton"], ["Cantwell"]]
    assert source.inventory()["train"][1].missing


def test_a_list_that_a_spreadsheet_has_written(root):
    text = (root / "split.csv").read_text()
    (root / "split.csv").write_text(text, encoding="utf-8-sig")
    assert names(Gibson(str(root), train=1, split_file=str(root / "split.csv")).splits())[0] == ["Adrian"]


def test_a_building_is_turned_upright_and_has_no_labels(root):
    (reference,) = Gibson(str(root), train=["Adrian"], validation=0, test=0).splits().train
    mesh = reference.load().mesh
    assert mesh.bounds.tolist() == [[0, 0, -3], [4, 2.5, 0]]
    assert (mesh.face_label == -1).all()


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"train": 3}, "scenes.train is 3, but Gibson has only 2 scenes"),
        ({"train": ["Adrien"]}, "not a scene of Gibson: did you mean Adrian"),
        ({"split_file": "nowhere.csv"}, r"scenes\.split_file is .*nowhere\.csv, which cannot be read"),
        ({"labels": False}, "labels is not an option of Gibson"),
    ],
)
def test_mistakes_are_one_sentence(root, settings, message):
    with pytest.raises(DeuxError, match=message):
        construct(Gibson, {"root": str(root), **settings}, "scenes").splits()


def test_a_list_of_another_kind_is_reported(root):
    (root / "split.csv").write_text("Adrian\nBolton\n")
    with pytest.raises(DeuxError, match="not a table with the columns id, train, val and test"):
        Gibson(str(root), split_file=str(root / "split.csv")).splits()
