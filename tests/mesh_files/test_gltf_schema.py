"""The types of glTF's JSON: what they are in real files, and each that is wrong is named with its place."""

import json

import pytest

from deux.mesh_files.gltf_schema import check_header

WHOLE = {
    "asset": {"version": "2.0", "generator": 3},
    "scenes": [{"nodes": [0]}],
    "nodes": [{"mesh": 0, "matrix": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1.0], "extras": [None]}],
    "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "targets": [{"POSITION": 0}]}]}],
    "accessors": [{"componentType": 5126, "count": 3, "type": "VEC3", "bufferView": 0, "min": "not read"}],
    "bufferViews": [{"buffer": 0, "byteLength": 36}],
    "buffers": [{"byteLength": 36, "uri": "data:," + "x" * 5000}],
    "animations": None,
}


def test_what_is_not_read_is_not_looked_at():
    check_header(WHOLE)


@pytest.mark.parametrize(
    ("keys", "value", "said"),
    [
        (("accessors", 0, "count"), None, r"accessors\[0\].count is None, but must be a whole number from 1"),
        (("accessors", 0, "count"), True, r"accessors\[0\].count is True"),
        (("accessors", 0, "count"), 10**400, r"accessors\[0\].count is 10+\.\.\.,"),
        (("nodes", 0, "matrix", 3), float("nan"), r"nodes\[0\].matrix\[3\] is nan, but must be a number"),
        (("nodes", 0, "matrix"), [1], r"nodes\[0\].matrix is \[1\], but must be a list of 16 values"),
        (("nodes", 0), [], r"nodes\[0\] is \[\], but must be an object"),
        (("meshes", 0, "primitives", 0, "attributes", "POSITION"), "0", r"attributes.POSITION is '0'"),
        (("meshes", 0, "primitives", 0), {}, r"meshes\[0\].primitives\[0\] has no attributes"),
        (("buffers", 0, "uri"), "a" * 5000, r"buffers\[0\].uri is 'a+\.\.\., but must be the name of a file"),
        (("asset",), None, "asset is None, but must be an object"),
    ],
)
def test_a_wrong_value_is_named(keys, value, said):
    header = json.loads(json.dumps(WHOLE))
    node = header
    for key in keys[:-1]:
        node = node[key]
    node[keys[-1]] = value
    with pytest.raises(ValueError, match=said):
        check_header(header)


def test_real_files_pass(shared_data):
    for path in sorted(shared_data("scenes").glob("*.glb")):
        content = path.read_bytes()
        check_header(json.loads(content[20 : 20 + int.from_bytes(content[12:16], "little")]))
