"""Fixtures that all tests share."""

import gc
import io
import logging
import os
import shutil
import signal
import subprocess
import sys
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import lru_cache
from pathlib import Path
from typing import Any

import pytest
from hydra.core.hydra_config import HydraConfig

if "PYTEST_XDIST_WORKER" in os.environ:
    # As many workers as cores: threads of torch, OpenCV and the commands that tests start would wait for each other.
    os.environ.setdefault("OMP_NUM_THREADS", "1")

if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
    # A shell starts its background jobs so, and the commands that tests interrupt would inherit it.
    signal.signal(signal.SIGINT, signal.default_int_handler)

from deux import memory_budget
from deux.__main__ import main
from deux.contracts import Scene
from deux.scenes.ray_caster import RayCaster
from deux_plugins.scenes.apartments import source
from deux_plugins.scenes.files import load_scene

SHARED = Path(__file__).resolve().parents[2] / "shared"

generated_flat = lru_cache(maxsize=16)(source.apartment)
"""As `deux_plugins.scenes.apartments.generator.apartment`, made once."""


_modules_left_out = 0


def pytest_runtest_setup() -> None:
    """Take what was imported until here out of the garbage collector, which would walk through it again and again.

    The largest packages are imported by the first test that needs them.
    """
    global _modules_left_out
    if len(sys.modules) > _modules_left_out + 20:
        gc.collect()
        gc.freeze()
        _modules_left_out = len(sys.modules)


@pytest.fixture(autouse=True)
def no_job_goes_on() -> Iterator[None]:
    """Hydra keeps the configuration of a sweep that ran in this process; paths would be relative to its folder."""
    yield
    HydraConfig.instance().cfg = None


@pytest.fixture
def leave_memory(monkeypatch: pytest.MonkeyPatch) -> Callable[[int], None]:
    """Let so much memory be free, in bytes, and nothing too small to be looked at: leave_memory(count)."""

    def leave(count: int) -> None:
        monkeypatch.setattr(memory_budget, "free_memory", lambda: count)
        monkeypatch.setattr(memory_budget, "SMALL", 0)

    return leave


@pytest.fixture(scope="session")
def command_line() -> Callable[..., int]:
    """Run the command inside this process, which spares the seconds of its imports: command_line(*arguments).

    It gives the exit code.
    """

    def run(*arguments: str) -> int:
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(sys, "argv", ["deux", *arguments])
            patch.setenv("HYDRA_FULL_ERROR", "1")
            patch.setattr(logging.root, "handlers", [])  # Hydra's hold files and streams of this one run
            patch.setattr(source, "apartment", generated_flat)  # commands go through the same few flats
            try:
                code = main()
            except SystemExit as left:
                code = int(left.code or 0)
            for handler in logging.root.handlers:
                with suppress(OSError):  # a log file on a full disk
                    handler.close()
        return code

    return run


@pytest.fixture(scope="session")
def shared_data() -> Callable[[str], Path]:
    """A function from the name of a folder of reference data to its path; it skips the test where there is none.

    The data is not part of this repository: it lies in `../shared`, as seen from the project's root.
    """

    def folder(name: str) -> Path:
        if not (SHARED / name).is_dir():
            pytest.skip(f"there is no reference data ../shared/{name} beside the project")
        return SHARED / name

    return folder


@pytest.fixture(scope="session")
def small_house(shared_data: Callable[[str], Path]) -> Scene:
    """A furnished flat of about 130 square metres."""
    return load_scene(shared_data("scenes") / "small_house.glb")


@pytest.fixture(scope="session")
def house_caster(small_house: Scene) -> RayCaster:
    """Rays against `small_house`."""
    return RayCaster(small_house.mesh)


@pytest.fixture(scope="session")
def lounge(shared_data: Callable[[str], Path]) -> Scene:
    """A scanned room with holes."""
    return load_scene(shared_data("scenes") / "lounge.ply")


@pytest.fixture(scope="session")
def installed_copy(tmp_path_factory: pytest.TempPathFactory) -> Callable[[Path], Path]:
    """Install a package from a copy into a folder of its own, which is not on the path: installed_copy(package)."""

    def install(package: Path) -> Path:
        source = tmp_path_factory.mktemp("source") / package.name
        shutil.copytree(package, source, ignore=shutil.ignore_patterns("__pycache__", "*.egg-info", "build"))
        folder = tmp_path_factory.mktemp("site")
        options = ["--no-deps", "--no-build-isolation", "--no-index", "--disable-pip-version-check"]
        command = [sys.executable, "-m", "pip", "install", *options, "--target", str(folder), str(source)]
        result = subprocess.run(command, capture_output=True, text=True, timeout=240, check=False)
        assert result.returncode == 0, result.stderr
        return folder

    return install


@pytest.fixture
def file_system_calls(monkeypatch: pytest.MonkeyPatch) -> Counter[str]:
    """Counts the calls by which Python code looks at files: each `stat`, listing of a folder and opened file."""
    calls: Counter[str] = Counter()

    def counted(module: Any, name: str) -> None:
        original = getattr(module, name)

        def call(*arguments: Any, **options: Any) -> Any:
            calls[name] += 1
            return original(*arguments, **options)

        monkeypatch.setattr(module, name, call)

    for name in ("stat", "lstat", "listdir", "scandir"):
        counted(os, name)
    counted(io, "open")
    return calls
