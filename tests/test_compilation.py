import os
import subprocess
import sys
from pathlib import Path

MODULE = """
from deux.compilation import compiled, nothing_compiled

@compiled
def double(x):
    return 2 * x

@compiled(nogil=True)
def unused(x):
    return x
"""

USE = """
import kernels
before = kernels.nothing_compiled()
kernels.double(1.0)
print(before, kernels.nothing_compiled())
"""


def use(folder: Path, cache: Path) -> str:
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(cache), "PYTHONPATH": str(folder)}
    command = [sys.executable, "-c", USE]
    return subprocess.run(command, env=environment, capture_output=True, text=True, timeout=120, check=True).stdout


def test_it_is_known_whether_machine_code_is_kept(tmp_path: Path) -> None:
    (tmp_path / "kernels.py").write_text(MODULE)
    assert use(tmp_path, tmp_path / "cache") == "True False\n"
    assert use(tmp_path, tmp_path / "cache") == "False False\n"
    assert use(tmp_path, tmp_path / "another") == "True False\n"


def test_where_no_machine_code_can_be_kept_it_is_logged_once() -> None:
    # numba keeps nothing of functions that are in no file.
    ended = subprocess.run(
        [sys.executable, "-c", MODULE.replace("double", "f") + "print(f(2), unused(3), nothing_compiled())"],
        capture_output=True,
        text=True,
        timeout=120,
        check=True,
    )
    assert ended.stdout == "4 3 False\n"
    assert ended.stderr.count("compiled code cannot be cached") == 1
