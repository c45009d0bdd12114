"""Files of torch.save from outside: read without executing what they may contain, bounded by memory."""

import io
import zipfile
from pathlib import Path
from typing import Any

import torch

from deux.errors import DeuxError
from deux.io.arrays import said
from deux.io.atomic import read_bytes
from deux.memory_budget import check_memory


def read_torch(path: Path) -> Any:
    """Read a file of tensors and plain values, on the CPU.

    Raises:
        DeuxError: the file is missing, damaged, holds code, or unpacks to more than there is memory for.
    """
    content = read_bytes(path)
    try:
        if zipfile.is_zipfile(io.BytesIO(content)):
            with zipfile.ZipFile(io.BytesIO(content)) as archive:
                size = sum(member.file_size for member in archive.infolist())
            check_memory(2 * size, f"{path}, which unpacks to {size / 2**30:,.1f} GiB,", "it is damaged")
        return torch.load(io.BytesIO(content), map_location="cpu", weights_only=True)
    except DeuxError:
        raise
    except Exception as error:  # a damaged or foreign file fails in many ways, depending on where
        cause = " ".join(said(error).split()[:20])
        raise DeuxError(
            f"{path} cannot be read as a checkpoint of tensors: it is damaged, something else, or holds code, which is "
            f"never run ({cause})."
        ) from error
