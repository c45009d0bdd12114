import os
import zipfile

import pytest
import torch

from deux.errors import DeuxError
from deux.io.torch_files import read_torch


class Touch:
    """Unpickled, it leaves a file behind."""

    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return os.system, (f"touch {self.path}",)


def test_tensors_come_back_and_code_is_not_run(tmp_path):
    torch.save({"a": torch.arange(3), "b": [1, "x"]}, tmp_path / "a.pt")
    found = read_torch(tmp_path / "a.pt")
    assert found["a"].tolist() == [0, 1, 2]
    assert found["b"] == [1, "x"]
    torch.save({"a": Touch(tmp_path / "marker")}, tmp_path / "b.pt")
    with pytest.raises(DeuxError, match=r"b\.pt cannot be read as a checkpoint of tensors"):
        read_torch(tmp_path / "b.pt")
    assert not (tmp_path / "marker").exists()


def test_a_file_that_unpacks_to_much_is_refused(tmp_path, leave_memory):
    with zipfile.ZipFile(tmp_path / "a.pt", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("archive/data/0", bytes(10**6))
    leave_memory(10**6)
    with pytest.raises(DeuxError, match=r"a\.pt, which unpacks to .* would take"):
        read_torch(tmp_path / "a.pt")
