"""Frames in one tensor on a device: rows that are used again, windows, and the transfer of several arrays."""

import numpy as np
import pytest
import torch

from deux.data.device_cache import FrameStack, Shipment, cut_on_cpu, cut_on_device

CPU = torch.device("cpu")


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])
def test_a_stack_gives_back_what_was_put_into_it_also_after_it_has_grown(dtype: type) -> None:
    rng = np.random.default_rng(0)
    arrays = [rng.integers(0, 255, (3, 5, 7)).astype(dtype) * (257 if dtype == np.uint16 else 1) for _ in range(6)]
    stack = FrameStack(arrays[0], CPU)
    rows = []
    for grown, array in zip((2, 0, 3, 0, 0, 1), arrays, strict=True):
        stack.grow(grown)
        rows.append(stack.free.pop())
        stack.put(rows[-1], array)
    assert sorted(rows) == list(range(6)) == list(range(stack.rows))
    for row, array in zip(rows, arrays, strict=True):
        np.testing.assert_array_equal(stack.get(row).numpy(), array)


def test_both_ways_to_cut_are_numpys() -> None:
    planes = np.random.default_rng(1).integers(0, 2**15, (6, 9, 11)).astype(np.int16)
    rows, columns = np.array([[2, 3, 4], [8, 7, 6], [0, 1, 2]]), np.array([[5, 4, 3, 2], [0, 1, 2, 3], [10, 9, 8, 7]])
    first = np.array([[0, 1], [4, 5], [2, 3]])
    expected = np.stack([planes[np.ix_(*its)] for its in zip(first, rows, columns, strict=True)])
    indices = [
        torch.from_numpy(one) for one in (first[:, :, None, None], rows[:, None, :, None], columns[:, None, None])
    ]
    for cut in (cut_on_cpu, cut_on_device):
        np.testing.assert_array_equal(cut(torch.from_numpy(planes), *indices).numpy(), expected)


def test_arrays_of_any_shape_arrive_as_they_were_sent() -> None:
    arrays = [
        np.arange(6).reshape(2, 1, 3, 1),
        np.array(255.0, np.float32),
        np.linspace(0, 1, 9, dtype=np.float32).reshape(1, 3, 3),
        np.empty(0, np.int64),
        np.arange(12).reshape(3, 4)[:, ::-2],
        np.array([-(2**62), 2**62]),
    ]
    shipment = Shipment()
    assert [shipment.add(array) for array in arrays] == list(range(len(arrays)))
    for array, tensor in zip(arrays, shipment.send(CPU), strict=True):
        assert tensor.is_contiguous()
        np.testing.assert_array_equal(tensor.numpy(), array)
