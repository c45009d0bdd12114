"""NumPy's files: what NumPy writes is read back, and headers that state something else are refused."""

import io
import zipfile

import numpy as np
import pytest

from deux.errors import DeuxError
from deux.io.arrays import read_array, read_arrays


@pytest.mark.parametrize("dtype", ["<f4", ">f8", "<i2", "|b1", "<c16", "|u1"])
@pytest.mark.parametrize("shape", [(), (0, 3), (4,), (2, 3, 4)])
@pytest.mark.parametrize("order", ["C", "F"])
def test_arrays_come_back(tmp_path, dtype, shape, order):
    array = np.asarray(np.random.default_rng(0).random(shape) * 9).astype(dtype).copy(order=order)
    np.save(tmp_path / "a.npy", array)
    found = read_array(tmp_path / "a.npy")
    assert found.dtype == array.dtype
    assert found.flags.writeable
    np.testing.assert_array_equal(found, array)


def test_objects_and_texts_are_no_numbers(tmp_path):
    for array in (np.array([{}], object), np.array(["a"]), np.zeros(2, [("a", "<f4")])):
        np.save(tmp_path / "a.npy", array, allow_pickle=True)
        with pytest.raises(DeuxError, match=r"a\.npy contains values of the type .* where numbers are expected"):
            read_array(tmp_path / "a.npy")


def test_a_file_of_another_length_than_in_its_header_is_refused(tmp_path):
    np.save(tmp_path / "a.npy", np.zeros((2, 2)))
    content = (tmp_path / "a.npy").read_bytes()
    for wrong in (content[:-1], content + b"\0", content.replace(b"(2, 2)", b"(9, 9)")):
        (tmp_path / "a.npy").write_bytes(wrong)
        with pytest.raises(DeuxError, match=r"a\.npy is damaged: its shape .* needs .* bytes, but it contains"):
            read_array(tmp_path / "a.npy")


def test_archives_come_back_and_are_refused_before_they_unpack(tmp_path, leave_memory):
    arrays = {"a": np.arange(6).reshape(2, 3), "b": np.array(0.5)}
    np.savez_compressed(tmp_path / "a.npz", **arrays)
    found = read_arrays(tmp_path / "a.npz")
    assert found.keys() == arrays.keys()
    for name, array in arrays.items():
        np.testing.assert_array_equal(found[name], array)

    content = io.BytesIO()
    with zipfile.ZipFile(content, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("a.npy", bytes(10**6))
    (tmp_path / "a.npz").write_bytes(content.getvalue())
    leave_memory(10**6)
    with pytest.raises(DeuxError, match=r"a\.npz, which unpacks to 0\.0 GiB, would take"):
        read_arrays(tmp_path / "a.npz")
