"""Available memory, and a check of large allocations before they are made.

The memory that an untrusted file needs is known from its header, such as the number of pixels of an image or elements
of an array. Call `check_memory` before allocating memory of such a size.
"""

from pathlib import Path

from deux.errors import DeuxError

SHARE = 0.5
"""Fraction of the free memory that one file, scene or prediction may use; the rest is for processing it."""

SMALL = 16 * 1024**2
"""Allocations up to this size in bytes are not checked, since reading the free memory would take too long."""

UNKNOWN_MEMORY = 4 * 1024**3
"""Free memory in bytes that is assumed if the system does not report it."""

_CONTROL_GROUP = Path("/sys/fs/cgroup")
_MEMORY = Path("/proc/meminfo")
_PROCESS = Path("/proc/self/statm")


def free_memory() -> int:
    """Memory that this process can still allocate, in bytes.

    On Linux, this is the minimum of the machine's free memory, the container's limit and the limit of the process's
    address space (`ulimit -v`).
    """
    limits = [] if (room := _free_address_space()) is None else [room]
    try:
        fields = dict(line.split(":") for line in _MEMORY.read_text().splitlines())
        limits.append(int(fields["MemAvailable"].split()[0]) * 1024)
        limit, used = ((_CONTROL_GROUP / name).read_text().strip() for name in ("memory.max", "memory.current"))
        if limit != "max":
            # Cached pages of files are freed when programs need memory.
            pages = dict(line.split() for line in (_CONTROL_GROUP / "memory.stat").read_text().splitlines())
            limits.append(max(0, int(limit) - int(used) + int(pages["inactive_file"])))
    except (OSError, KeyError, ValueError):  # another operating system, or no container
        pass
    return min(limits, default=UNKNOWN_MEMORY)


def memory_budget() -> int:
    """Memory that one file, scene or prediction may use, in bytes."""
    return int(SHARE * free_memory())


def check_memory(size: int, what: str, remedy: str) -> None:
    """Check an allocation against `memory_budget` before it is made; sizes up to `SMALL` are always accepted.

    Args:
        size: peak memory in bytes, including intermediate results.
        what: description of the data, with its file; the message begins with it.
        remedy: what the user can do; the message ends with it.

    Raises:
        DeuxError: the size exceeds the budget.

    Example:
        >>> check_memory(10**18, "scene.glb: its 5,000 instances", "draw fewer")
        Traceback (most recent call last):
        ...
        deux.errors.DeuxError: scene.glb: its 5,000 instances would take 931,322,574.6 GiB of memory, ...
    """
    if size > SMALL and size > (budget := memory_budget()):
        raise DeuxError(
            f"{what} would take {size / 2**30:,.1f} GiB of memory, more than the {budget / 2**30:,.1f} GiB that are "
            f"half of what is free: {remedy}."
        )


def _free_address_space() -> int | None:
    """Bytes by which the address space of this process may still grow; None without a limit."""
    try:
        import resource  # on Unix only

        limit = resource.getrlimit(resource.RLIMIT_AS)[0]
        if limit == resource.RLIM_INFINITY:
            return None
        return max(0, limit - int(_PROCESS.read_text().split()[0]) * resource.getpagesize())
    except (ImportError, OSError, ValueError, IndexError):
        return None
