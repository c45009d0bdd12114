from pathlib import Path

import numpy as np
import pytest

from deux.errors import DeuxError
from deux.mesh_files.ply_elements import Ragged, read_ply_elements, read_ply_header

HEADER = """ply
format {form} 1.0
comment made by hand
obj_info scan 7
element vertex 3
property double x
property int64 id
property uint8 red
element face 2
property list uint8 int vertex_indices
property short object_id
property list int float weight
element camera 0
property float fov
end_header
"""
VERTICES = [(0.5, -7, 200), (1.25, 2**40, 0), (-3e10, 3, 255)]
FACES = [((0, 1, 2), -5, (0.5,)), ((2, 1, 0, 1), 300, ())]
ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}


def written(form: str) -> bytes:
    """The file with `VERTICES` and `FACES`, put together value by value."""
    order, body = ORDERS[form], b""

    def put(kind: str, *values: float) -> bytes:
        if not order:
            return " ".join(map(str, (*values, ""))).encode()
        return np.array(values, order + kind).tobytes()

    for x, number, red in VERTICES:
        body += put("f8", x) + put("i8", number) + put("u1", red) + (b"" if order else b"\n")
    for index, label, weight in FACES:
        body += put("u1", len(index)) + put("i4", *index) + put("i2", label) + put("i4", len(weight))
        body += put("f4", *weight) + (b"" if order else b"\r\n")
    return HEADER.format(form=form).encode() + body


@pytest.mark.parametrize("form", ORDERS)
def test_all_elements_and_properties_in_every_format(tmp_path: Path, form: str) -> None:
    path = tmp_path / "scan.ply"
    path.write_bytes(written(form))
    elements = read_ply_elements(path)
    assert list(elements) == ["vertex", "face", "camera"]
    vertex, face = elements["vertex"], elements["face"]
    for column, (name, kind) in enumerate((("x", np.float64), ("id", np.int64), ("red", np.uint8))):
        assert vertex[name].dtype == kind
        np.testing.assert_array_equal(vertex[name], [row[column] for row in VERTICES])
    assert (face["object_id"].dtype, face["object_id"].tolist()) == (np.int16, [-5, 300])
    index, weight = face["vertex_indices"], face["weight"]
    assert isinstance(index, Ragged)
    assert (index.values.dtype, index.values.tolist(), index.lengths.tolist()) == (
        np.int32,
        [0, 1, 2, 2, 1, 0, 1],
        [3, 4],
    )
    assert (weight.values.dtype, weight.values.tolist(), weight.lengths.tolist()) == (np.float32, [0.5], [1, 0])
    assert elements["camera"]["fov"].size == 0


def test_the_header_alone(tmp_path: Path) -> None:
    path = tmp_path / "scan.ply"
    path.write_bytes(written("binary_big_endian"))
    header = read_ply_header(path)
    assert header.comments == ["made by hand", "scan 7"]
    assert [(element.name, element.count) for element in header.elements] == [("vertex", 3), ("face", 2), ("camera", 0)]
    assert path.read_bytes()[: header.size].endswith(b"end_header\n")


@pytest.mark.parametrize("form", ORDERS)
def test_a_file_that_ends_early_is_named(tmp_path: Path, form: str) -> None:
    path, content = tmp_path / "scan.ply", written(form)
    for missing in (6, 30, 80):
        path.write_bytes(content[:-missing])
        with pytest.raises(DeuxError, match=r"scan\.ply is damaged or not a \.ply file"):
            read_ply_elements(path)


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"plyr",
        b"solid box",
        b"ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\n",
        b"ply\nelement vertex 0\nend_header\n",
        b"ply\nformat ascii 1.0\nelement vertex 1\nproperty quaternion q\nend_header\n0\n",
        b"ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nend_header\nzero\n",
        b"ply\nformat ascii 1.0\nelement f 1\nproperty list char int i\nend_header\n-1\n",
        b"ply\nformat binary_little_endian 1.0\nelement f 1\nproperty list char int i\nend_header\n\xff\0\0\0\0",
        b"ply\nformat binary_little_endian 1.0\nelement f 1\nproperty list uint int i\nend_header\n\xff\xff\xff\xff\0",
    ],
)
def test_damage_is_one_sentence(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "scan.ply"
    path.write_bytes(content)
    with pytest.raises(DeuxError, match=r"scan\.ply") as error:
        read_ply_elements(path)
    assert "\n" not in str(error.value)
