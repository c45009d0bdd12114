import os
import pickle
import subprocess
import sys
from pathlib import Path

import pytest
import trimesh

from deux.errors import DeuxError
from deux.scenes.sources import ApartmentReference, FileReference, scene_splits


@pytest.fixture
def boxes(tmp_path):
    """Three different scene files: a.ply, b.ply, c.ply."""
    paths = []
    for size, name in enumerate("abc", start=3):
        paths.append(tmp_path / f"{name}.ply")
        trimesh.creation.box([size] * 3).export(paths[-1])
    return [str(path) for path in paths]


def seeds(scenes):
    return [scene.seed for scene in scenes]


def test_numbers_of_apartments_are_disjoint_seeds():
    splits = scene_splits({"source": "apartments", "train": 3, "validation": 1, "test": 2})
    assert (len(splits.train), len(splits.validation), len(splits.test)) == (3, 1, 2)
    everything = (*splits.train, *splits.validation, *splits.test)
    assert len({scene.seed for scene in everything}) == len({scene.name for scene in everything}) == 6
    more = scene_splits({"source": "apartments", "train": 50, "validation": 9, "test": 9})
    assert more.train[:3] == splits.train, "asking for more keeps the first"
    assert more.test[:2] == splits.test


def test_seeds_can_be_listed():
    splits = scene_splits({"source": "apartments", "train": [7, 3], "test": [11]})
    assert seeds(splits.train) == [7, 3]
    assert splits.validation == ()
    assert seeds(splits.test) == [11]


def test_references_are_values(boxes):
    for reference in (ApartmentReference("a", 3), FileReference("a", Path(boxes[0]))):
        assert {reference: 1}[pickle.loads(pickle.dumps(reference))] == 1


def test_an_apartment_loads_under_its_name_and_identity():
    (reference,) = scene_splits({"source": "apartments", "train": [5], "test": 1}).train
    scene = reference.load()
    assert (scene.name, scene.identity) == (reference.name, reference.identity)
    assert reference.identity != ApartmentReference("x", 6).identity


def test_files_load_from_anywhere_under_one_identity(boxes, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    splits = scene_splits({"source": "files", "train": ["a.ply", "b.ply"], "test": "c.ply"})
    monkeypatch.chdir("/")
    assert [scene.name for scene in (*splits.train, *splits.test)] == ["a", "b", "c"]
    scene = splits.train[0].load()
    assert (scene.name, scene.identity) == ("a", splits.train[0].identity)
    assert str(tmp_path) not in scene.identity
    other = tmp_path / "elsewhere.ply"
    other.write_bytes(Path(boxes[0]).read_bytes())
    assert FileReference("other", other).identity == scene.identity
    assert splits.train[1].identity != scene.identity


def test_a_changed_file_gets_a_new_identity(boxes):
    reference = FileReference("a", Path(boxes[0]))
    before = reference.identity
    trimesh.creation.box([9, 9, 9]).export(boxes[0])
    os.utime(boxes[0], (1, 1))
    assert reference.identity != before


def test_up_reaches_the_scene(boxes):
    trimesh.creation.box([4, 2, 9]).export(boxes[0])
    (lying,) = scene_splits({"source": "files", "train": boxes[0], "test": boxes[1], "up": "z"}).train
    assert lying.load().mesh.bounds[1].tolist() == [2.0, 4.5, 1.0]


def test_equal_stems_are_told_apart_by_their_folders(tmp_path):
    for folder in ("office", "hotel"):
        (tmp_path / folder).mkdir()
        trimesh.creation.box([4, 4, 4]).export(tmp_path / folder / "mesh.ply")
    train, test = (str(tmp_path / folder / "mesh.ply") for folder in ("office", "hotel"))
    splits = scene_splits({"source": "files", "train": train, "test": test})
    assert (splits.train[0].name, splits.test[0].name) == ("office_mesh", "hotel_mesh")
    assert splits.train[0].load().name == "office_mesh"


def test_a_file_in_two_splits_must_be_allowed(boxes):
    settings = {"source": "files", "train": boxes, "test": boxes[:1]}
    with pytest.raises(DeuxError, match=r"a\.ply is in scenes\.train and scenes\.test"):
        scene_splits(settings)
    splits = scene_splits({**settings, "allow_overlap": True})
    assert splits.test[0] == splits.train[0]


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"source": "apartment", "train": 1, "test": 1}, "did you mean apartments"),
        ({"train": 1, "test": 1}, "scenes.source"),
        ({"source": "apartments", "trian": 1, "test": 1}, "did you mean train"),
        ({"source": "apartments", "train": 1}, r"scenes\.test names no scene"),
        ({"source": "apartments", "train": 0, "test": 1}, r"scenes\.train names no scene"),
        ({"source": "apartments", "train": [1, 2], "test": [2]}, "seed 2 is in scenes.train and scenes.test"),
        ({"source": "apartments", "train": 200_001, "test": 1}, "seed 200000 is in"),
        ({"source": "apartments", "train": [1, 1], "test": [2]}, "once is enough"),
        ({"source": "apartments", "train": -2, "test": 1}, r"scenes\.train is"),
        ({"source": "apartments", "train": True, "test": 1}, r"scenes\.train is"),
        ({"source": "apartments", "train": "many", "test": 1}, r"scenes\.train is"),
        ({"source": "apartments", "train": [0.5], "test": 1}, r"scenes\.train is"),
        ({"source": "files", "train": 3, "test": "b.ply"}, "must be a path or a list of paths"),
        ({"source": "files", "train": "nowhere.ply", "test": "b.ply"}, "no scene file"),
        ({"source": "files", "train": "a.ply", "test": "b.ply", "up": "x"}, "must be y or z"),
        ({"source": "files", "train": [], "test": "b.ply"}, r"scenes\.train names no scene"),
    ],
)
def test_mistakes_are_one_sentence(boxes, tmp_path, monkeypatch, settings, message):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(DeuxError, match=message) as error:
        scene_splits(settings)
    assert "\n" not in str(error.value)


def test_splits_are_made_without_torch():
    code = (
        "import sys; from deux.scenes.sources import scene_splits;"
        "scene_splits(dict(source='apartments', train=2, test=1));"
        "assert 'torch' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
