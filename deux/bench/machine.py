"""Description of the machine on which benchmarks are run."""

import os
import platform
from dataclasses import asdict, dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import cv2
import torch

from deux.errors import DeuxError
from deux.inference.precision import default_device

PACKAGES = ("deux", "torch", "lightning", "numpy", "numba", "embreex", "pyrender")
"""Packages whose versions are reported."""


@dataclass(frozen=True)
class Machine:
    """Description of a machine, without its host name.

    Args:
        processor: model name of the processor.
        cores: number of cores that this process may use.
        threads: number of threads of torch and OpenCV in this process.
        accelerator: name of the GPU on which models compute, or "none".
        load: load average of the last minute; values well above 0 mean that other processes were running.
        versions: versions of Python and of `PACKAGES`.
    """

    processor: str
    cores: int
    threads: int
    accelerator: str
    load: float
    versions: dict[str, str]

    def __str__(self) -> str:
        versions = ", ".join(f"{name} {number}" for name, number in self.versions.items())
        return (
            f"{self.cores} cores of {self.processor}, threads of torch and OpenCV: {self.threads}, accelerator: "
            f"{self.accelerator}, load average at the start: {self.load:.1f}; {versions}"
        )

    def as_json(self) -> dict[str, Any]:
        """The description as JSON values."""
        return asdict(self)


def prepare_machine(threads: int | None, device: str = "auto") -> Machine:
    """Set the number of threads of this process and describe the machine.

    Args:
        threads: number of threads of torch and OpenCV; None for all cores.
        device: device on which models compute: "cpu", "cuda", or "auto" for a CUDA device if one is available.

    Raises:
        DeuxError: `device` is "cuda" and no CUDA device is available.
    """
    if device == "cuda" and not torch.cuda.is_available():
        raise DeuxError("--device cuda: PyTorch finds no CUDA device here; python -m deux.doctor says more.")
    used = default_device(device).type == "cuda"
    count = threads or cores()
    torch.set_num_threads(count)
    cv2.setNumThreads(count)
    return Machine(
        processor=processor(),
        cores=cores(),
        threads=count,
        accelerator=torch.cuda.get_device_name() if used else "none",
        load=os.getloadavg()[0],
        versions={"Python": platform.python_version(), **{name: version(name) for name in PACKAGES}},
    )


def cores() -> int:
    """Number of cores that this process may use."""
    return len(os.sched_getaffinity(0))


def processor() -> str:
    """Model name of the processor."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor()
    models = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return models[0] if models else platform.machine()
