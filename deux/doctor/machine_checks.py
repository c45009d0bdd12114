"""Checks of the machine: processor, memory, GPUs, threads, and the folders that deux writes to."""

import os
import platform
import shutil
import tempfile
from collections.abc import Sequence
from pathlib import Path

import torch
from omegaconf import DictConfig

from deux.bench.machine import cores, processor
from deux.compilation import cache_folders
from deux.configuration import user_path
from deux.doctor.checkup import Checkup
from deux.inference.precision import default_precision
from deux.memory_budget import free_memory

THREAD_VARIABLES = ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS", "OMP_WAIT_POLICY", "GOMP_SPINCOUNT")
"""Environment variables that affect the number of threads or how they wait."""

LEAST_SPACE = 2**30
"""Minimal free space in bytes for runs and datasets; the first experiment needs a tenth of it."""


def check_machine(checkup: Checkup) -> None:
    """Report operating system, processor, threads, memory and graphics cards."""
    checkup.heading("Machine")
    checkup.fact("system", f"{platform.system()} {platform.release()} {platform.machine()}, {_c_library()}")
    checkup.fact("Python", f"{platform.python_version()} ({platform.python_implementation()})")
    checkup.fact("processor", f"{cores()} cores for this process, of {os.cpu_count()}, {processor()}")
    settings = [f"{name}={os.environ[name]}" for name in THREAD_VARIABLES if name in os.environ]
    checkup.fact("threads", ", ".join([f"{torch.get_num_threads()} of torch", *settings]))
    checkup.fact("free memory", f"{free_memory() / 2**30:.1f} GiB")
    checkup.fact("GPU", graphics_card())
    checkup.fact("precision", f"{default_precision()} by default")


def check_accelerator(checkup: Checkup, cfg: DictConfig) -> None:
    """Report a fault if `trainer.accelerator` requires GPUs that do not exist."""
    wanted, devices = cfg.trainer.get("accelerator", "auto"), cfg.trainer.get("devices", 1)
    if wanted not in ("gpu", "cuda"):
        return
    count = devices if isinstance(devices, int) else 1
    if torch.cuda.device_count() < count:
        checkup.fault(
            f"trainer.accelerator={wanted} trainer.devices={devices} needs more GPUs than the "
            f"{torch.cuda.device_count()} that torch can use here: trainer.accelerator=auto uses what is available."
        )


def check_folders(checkup: Checkup, cfg: DictConfig) -> None:
    """Report whether the folders that deux writes to are writable, and their free space.

    The output folder is needed by every task. Without the others, deux is only slower, so they are not faults.
    """
    checkup.heading("Folders")
    outputs = user_path(cfg.paths.outputs)
    if obstacle := write_obstacle(outputs):
        checkup.fault(f"paths.outputs={outputs} cannot be written: {obstacle}.")
    else:
        checkup.fact("outputs", f"{outputs}, {_free(outputs)}")
        if shutil.disk_usage(_existing(outputs)).free < LEAST_SPACE:
            checkup.fault(f"paths.outputs={outputs} is on a disk with less than 1 GiB free: choose another folder.")
    _report_folders(checkup, "compiled code", cache_folders())
    _report_folders(checkup, "temporary files", [Path(tempfile.gettempdir())])


def _report_folders(checkup: Checkup, name: str, folders: Sequence[Path]) -> None:
    """Report folders of one purpose, and each that is not writable."""
    if not folders:
        checkup.fact(name, "not cached: no folder is writable, and every start takes some seconds longer")
        return
    above = Path(os.path.commonpath(folders))
    checkup.fact(name, f"{above}, {_free(above)}")
    for folder in folders:
        if obstacle := write_obstacle(folder):
            checkup.fact(name, f"{folder} cannot be written: {obstacle}")


def graphics_card() -> str:
    """Description of the GPUs that torch can use, or of why there are none."""
    if not torch.cuda.is_available():
        built = (
            f"torch is built with CUDA {torch.version.cuda}" if torch.version.cuda else "torch is built without CUDA"
        )
        return f"none that torch can use ({built}): models run on the CPU"
    memory = torch.cuda.get_device_properties(0).total_memory / 2**30
    return (
        f"{torch.cuda.get_device_name(0)}, {memory:.0f} GiB; {torch.cuda.device_count()} in all, CUDA "
        f"{torch.version.cuda}"
    )


def write_obstacle(folder: Path) -> str:
    """Why this process cannot write to a folder, which need not exist yet; "" if it can."""
    existing = _existing(folder)
    if not existing.is_dir():
        return f"{existing} is a file"
    try:
        with tempfile.TemporaryFile(dir=existing):
            return ""
    except OSError as error:
        return error.strerror or type(error).__name__


def _existing(path: Path) -> Path:
    """The path, or its nearest existing parent."""
    return next(parent for parent in (path, *path.parents) if parent.exists())


def _free(folder: Path) -> str:
    return f"{shutil.disk_usage(_existing(folder)).free / 2**30:.1f} GiB free"


def _c_library() -> str:
    return " ".join(platform.libc_ver()).strip() or "an unknown C library"
