"""Memory that a study or an analysis needs, checked from counts before anything is made or read."""

import os
import resource
from pathlib import Path

from tripod_doe.errors import InputError
from tripod_doe.number_text import size


def refuse_too_many_points(count: int, each: int) -> None:
    """Refuse a list of points that does not fit into the free memory.

    Raises:
        InputError: With the number of points and their memory.
    """
    remedy = "use fewer levels or samples, or split the study"
    refuse_too_much_memory(count * each, f"a list of {count:,} points", remedy)


def refuse_too_much_memory(needed: int, what: str, remedy: str) -> None:
    """Refuse data that does not fit into the free memory; InputError with both numbers."""
    if needed > (free := _free_memory()):
        raise InputError(f"{what} needs about {size(needed)} of memory, {size(free)} are free: {remedy}")


def _free_memory() -> int:
    """Bytes that this process can get without swapping, within a limit of its address space if there is one."""
    return max(min(_available(), _addresses_left()), 0)


def _available() -> int:
    """Free memory of the machine; all memory if the system does not report it."""
    try:
        text = Path("/proc/meminfo").read_text(encoding="ascii")
        available = next(line for line in text.splitlines() if line.startswith("MemAvailable:"))
        return int(available.split()[1]) * 1024
    except (OSError, StopIteration):
        return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")


def _addresses_left() -> int:
    """Bytes below the limit that `ulimit -v` sets."""
    limit, _ = resource.getrlimit(resource.RLIMIT_AS)
    try:
        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
    except OSError:
        pages = 0
    return (1 << 63) - 1 if limit == resource.RLIM_INFINITY else limit - pages * os.sysconf("SC_PAGE_SIZE")
