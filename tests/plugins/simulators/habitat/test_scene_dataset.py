import json
from collections.abc import Callable
from pathlib import Path

import pytest

from deux.contracts import SceneReference
from deux.errors import DeuxError
from deux_plugins.scenes.apartments import Apartments
from deux_plugins.scenes.files import FileReference
from deux_plugins.simulators.habitat.scene_dataset import check_config, scene_file, write_config


def attributes(scene: SceneReference, folder: Path) -> dict:
    config = json.loads(write_config(scene, folder).read_text())
    assert config["stages"]["paths"] == {".glb": [str(scene.file)]}
    return config["stages"]["default_attributes"]


@pytest.mark.parametrize(
    ("up", "axis", "front"), [("y", [0.0, 1.0, 0.0], [0.0, 0.0, -1.0]), ("z", [0.0, 0.0, 1.0], [0.0, 1.0, 0.0])]
)
def test_the_axes_of_the_file_are_passed_on(
    up: str, axis: list, front: list, make_room: Callable[..., SceneReference], tmp_path: Path
) -> None:
    written = attributes(make_room(up), tmp_path)
    assert (written["up"], written["front"]) == (axis, front)
    assert written["shader_type"] == "flat"
    assert "semantic_asset" not in written


def test_a_semantic_ply_is_passed_on_as_upright(make_room: Callable[..., SceneReference], tmp_path: Path) -> None:
    scene = make_room("z", ("_semantic.ply", ".house"))
    written = attributes(scene, tmp_path)
    assert written["semantic_asset"] == str(scene.file.with_name("room_semantic.ply"))
    assert written["semantic_descriptor_filename"] == str(scene.file.with_name("room.house"))
    assert (written["semantic_up"], written["semantic_front"]) == ([0.0, 1.0, 0.0], [0.0, 0.0, -1.0])
    assert written["has_semantic_textures"] is False


def test_a_semantic_glb_lies_as_the_scene(make_room: Callable[..., SceneReference], tmp_path: Path) -> None:
    written = attributes(make_room("z", (".semantic.glb", ".semantic.txt")), tmp_path)
    assert (written["semantic_up"], written["semantic_front"]) == (written["up"], written["front"])
    assert written["has_semantic_textures"] is True


def test_a_semantic_mesh_without_its_description_is_left_out(
    make_room: Callable[..., SceneReference], tmp_path: Path
) -> None:
    assert "semantic_asset" not in attributes(make_room("z", ("_semantic.ply", ".txt")), tmp_path)


def test_a_scene_that_is_in_no_file_is_refused() -> None:
    with pytest.raises(DeuxError, match="is in no file"):
        scene_file(Apartments(train=1, validation=0, test=0).splits().train[0])


def test_a_file_in_another_unit_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DeuxError, match=r"reads files in metres, and a unit of .*cm\.glb is 0\.01 m"):
        scene_file(FileReference("cm", tmp_path / "cm.glb", scale=0.01))


def test_a_configuration_of_the_users_is_checked(tmp_path: Path) -> None:
    there = tmp_path / "mp3d.scene_dataset_config.json"
    there.write_text("{}")
    assert check_config(str(there)) == there
    with pytest.raises(DeuxError, match="ends in"):
        check_config(str(tmp_path / "mp3d.json"))
    with pytest.raises(DeuxError, match="no such file"):
        check_config(str(tmp_path / "hm3d.scene_dataset_config.json"))
