import mmap
import resource
from collections.abc import Callable
from pathlib import Path

import pytest

from deux import memory_budget
from deux.errors import DeuxError
from deux.memory_budget import check_memory, free_memory


def test_free_memory_is_that_of_the_container(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(memory_budget, "_MEMORY", tmp_path / "meminfo")
    monkeypatch.setattr(memory_budget, "_CONTROL_GROUP", tmp_path)
    assert free_memory() == memory_budget.UNKNOWN_MEMORY
    (tmp_path / "meminfo").write_text("MemTotal:  16000 kB\nMemAvailable:   9000 kB\nHugePages_Total:  0\n")
    assert free_memory() == 9000 * 1024
    for name, value in (("memory.max", "max"), ("memory.current", "3000000"), ("memory.stat", "anon 1\nfile 2\n")):
        (tmp_path / name).write_text(f"{value}\n")
    assert free_memory() == 9000 * 1024
    (tmp_path / "memory.max").write_text("5000000\n")
    (tmp_path / "memory.stat").write_text("anon 1000\ninactive_file 500000\n")
    assert free_memory() == 2_500_000


def test_a_limit_of_the_address_space_counts() -> None:
    before, limits = free_memory(), resource.getrlimit(resource.RLIMIT_AS)
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    room = min(before // 2, 2**30)
    resource.setrlimit(resource.RLIMIT_AS, (pages * resource.getpagesize() + room, limits[1]))
    try:
        assert room - 2**26 <= free_memory() <= room
        with pytest.raises(OSError, match="Cannot allocate memory"):  # what is mapped already may hold an array
            mmap.mmap(-1, 2 * room)
        mmap.mmap(-1, int(0.9 * free_memory())).close()
    finally:
        resource.setrlimit(resource.RLIMIT_AS, limits)


def test_half_of_what_is_free_may_be_taken(leave_memory: Callable[[int], None]) -> None:
    leave_memory(4 * 2**30)
    check_memory(2 * 2**30, "a.glb", "draw less")
    with pytest.raises(DeuxError) as caught:
        check_memory(2 * 2**30 + 2**29, "a.glb", "draw less")
    assert str(caught.value) == (
        "a.glb would take 2.5 GiB of memory, more than the 2.0 GiB that are half of what is free: draw less."
    )


def test_what_is_small_is_not_looked_at(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(memory_budget, "free_memory", lambda: 1000)
    check_memory(memory_budget.SMALL, "a.png", "make it smaller")
    with pytest.raises(DeuxError, match="make it smaller"):
        check_memory(memory_budget.SMALL + 1, "a.png", "make it smaller")
