"""What the four scanned sets share; each has a test file of its own beside this one."""

import numpy as np
import pytest
from scan_scenes import room, write_textured

from deux_plugins.scenes.scan_dataset import BLOCK, BLOCKS, ScanFiles, ScanReference


def identity(path, *annotation) -> str:
    return ScanReference("a", path, annotation=annotation).identity


@pytest.mark.parametrize("size", [1, BLOCK - 1, 3 * BLOCK, BLOCK * BLOCKS, 5 * BLOCK * BLOCKS + 7])
def test_the_identity_is_that_of_the_content(tmp_path, size):
    content = np.random.default_rng(size).bytes(size)
    variants = {
        "same": content,
        "first": bytes([content[0] ^ 1]) + content[1:],
        "last": content[:-1] + bytes([content[-1] ^ 1]),
        "longer": content + b"\0",
        "middle": b"" if size > BLOCK * BLOCKS else content[: size // 2] + b"?!" + content[size // 2 + 2 :],
    }
    (tmp_path / "scene.glb").write_bytes(content)
    original = identity(tmp_path / "scene.glb")
    for name, changed in variants.items():
        (tmp_path / f"{name}.glb").write_bytes(changed)
        assert (identity(tmp_path / f"{name}.glb") == original) == (name == "same"), name


def test_the_textures_of_an_obj_file_belong_to_it(tmp_path):
    """Two copies of one building, of which one's picture differs in a pixel."""
    for name in ("a", "b", "c"):
        write_textured(tmp_path / name / "house.obj", room())
    picture = next((tmp_path / "c").glob("*.png"))
    picture.write_bytes(picture.read_bytes() + b"\0")
    a, b, c = (identity(tmp_path / name / "house.obj") for name in ("a", "b", "c"))
    assert a == b != c


def test_labels_are_part_of_the_identity(tmp_path):
    for name in ("scene.glb", "a.house", "b.house"):
        (tmp_path / name).write_text(name)
    known = {
        identity(tmp_path / "scene.glb", *(tmp_path / n for n in names)) for names in ((), ("a.house",), ("b.house",))
    }
    assert len(known) == 3


def test_what_is_wrong_with_a_mesh_file_is_reported(tmp_path):
    path = tmp_path / "scene" / "scene.glb"
    assert ScanFiles(path).fault == f"there is no folder {path.parent}"
    write_textured(path, room())
    assert ScanFiles(path).fault == ""
    size = path.stat().st_size
    path.write_bytes(path.read_bytes()[:-100])
    assert ScanFiles(path).fault == f"{path} is truncated after {size - 100} of {size} bytes"
    path.write_bytes(b"")
    assert ScanFiles(path).fault == f"{path} is empty"
