"""Safe reading of files written by torch.save: without executing code, and limited by the memory."""

import io
import zipfile
from pathlib import Path
from typing import Any

import torch

from deux.errors import DeuxError, error_text
from deux.io.atomic import read_bytes
from deux.memory_budget import check_memory


def read_torch(path: Path) -> Any:
    """Read a file of tensors and plain values, on the CPU.

    Raises:
        DeuxError: the file is missing, damaged, contains code, or is too large for the memory when unpacked.
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
    except Exception as error:  # torch raises many kinds of errors for damaged and foreign files
        cause = " ".join(error_text(error).split()[:20])
        raise DeuxError(
            f"{path} cannot be read as a checkpoint of tensors: it is damaged, not a checkpoint, or contains code, "
            f"which is never executed ({cause})."
        ) from error
