import numpy as np
import pytest
import torch

from deux.collection.transfers import download, upload

DEVICES = [
    "cpu",
    pytest.param(
        "cuda", marks=[pytest.mark.gpu, pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a GPU")]
    ),
]


def arrays():
    random = np.random.default_rng(0)
    return [
        random.integers(0, 256, (2, 3, 5, 7, 3), np.uint8),
        random.random((2, 5, 7), np.float32),
        np.zeros((2, 0, 4, 4), np.float32),
        random.random((3, 3)),
        np.asfortranarray(random.random((4, 6), np.float32))[:, ::2],
    ]


@pytest.mark.parametrize("device", DEVICES)
def test_arrays_arrive_as_they_were(device):
    sent = upload(arrays(), torch.device(device))
    for tensor, array in zip(sent, arrays(), strict=True):
        assert tensor.device.type == device
        np.testing.assert_array_equal(tensor.cpu().numpy(), array, strict=True)


def test_what_is_uploaded_is_a_copy():
    original = np.ones(4, np.float32)
    (sent,) = upload([original], torch.device("cpu"))
    original[:] = 5.0
    assert sent.tolist() == [1.0] * 4


@pytest.mark.parametrize("device", DEVICES)
def test_tensors_come_back_in_memory_of_their_own(device):
    tensors = [torch.rand(3, 4, device=device), torch.rand((), device=device), torch.rand(4, 3, device=device).T]
    found = download(tensors)
    for array, tensor in zip(found, tensors, strict=True):
        np.testing.assert_array_equal(array, tensor.cpu().numpy(), strict=True)
    found[0][:] = -1.0
    assert float(tensors[0].min()) >= 0.0
    assert found[1] >= 0.0
    assert download([]) == []
