"""How much memory there is, and the refusal of what would take more than its part of it.

What a file from outside asks for is known before it is asked for: the pixels that a picture's header states, the
elements of an array, the instances of a node. Whoever is about to take memory for such a number asks `check_memory`.
"""

from pathlib import Path

from deux.errors import DeuxError

SHARE = 0.5
"""Part of the free memory that one file, scene or prediction may take; the rest is for what is made of it."""

SMALL = 16 * 1024**2
"""Bytes up to which nothing is refused: to ask what is free takes longer than to decode a small picture."""

UNKNOWN_MEMORY = 4 * 1024**3
"""Bytes that are taken to be available where the system does not say."""

_CONTROL_GROUP = Path("/sys/fs/cgroup")
_MEMORY = Path("/proc/meminfo")
_PROCESS = Path("/proc/self/statm")


def free_memory() -> int:
    """Bytes that this process can still take, as Linux says it.

    Of what is free on the machine, within the limit of the container, and within the limit of the process's address
    space (`ulimit -v`), the least.
    """
    found = [room for room in (_room_of_process(),) if room is not None]
    try:
        fields = dict(line.split(":") for line in _MEMORY.read_text().splitlines())
        found.append(int(fields["MemAvailable"].split()[0]) * 1024)
        limit, used = ((_CONTROL_GROUP / name).read_text().strip() for name in ("memory.max", "memory.current"))
        if limit != "max":
            # What the group's files occupy in memory is given up when programs need it.
            pages = dict(line.split() for line in (_CONTROL_GROUP / "memory.stat").read_text().splitlines())
            found.append(max(0, int(limit) - int(used) + int(pages["inactive_file"])))
    except (OSError, KeyError, ValueError):  # another system, or no container
        pass
    return min(found, default=UNKNOWN_MEMORY)


def memory_budget() -> int:
    """Bytes that one file, scene or prediction may take now."""
    return int(SHARE * free_memory())


def check_memory(size: int, what: str, remedy: str) -> None:
    """Refuse what would take more than `memory_budget`, before it is asked for; up to `SMALL` nothing is.

    Args:
        size: bytes at its greatest, intermediate results included.
        what: what takes them, with its file; it begins the message.
        remedy: what would be right; it ends the message.

    Raises:
        DeuxError: it is too much.

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


def _room_of_process() -> int | None:
    """Bytes by which the address space of this process may still grow; None without a limit."""
    try:
        import resource  # of Unix

        limit = resource.getrlimit(resource.RLIMIT_AS)[0]
        if limit == resource.RLIM_INFINITY:
            return None
        return max(0, limit - int(_PROCESS.read_text().split()[0]) * resource.getpagesize())
    except (ImportError, OSError, ValueError, IndexError):
        return None
