"""What a study needs in memory, from counts alone, before any point is made."""

from __future__ import annotations

import os
from pathlib import Path

from tripod_doe.errors import InputError

__all__ = ["refuse_too_many_points"]

_POINT_BYTES = 40  # fingerprint, order, constraint and stored result of a point
_FACTOR_BYTES = 24  # a value of a point that is held in memory, with the copies while it is made


def refuse_too_many_points(count: int, held: int) -> None:
    """Refuse a list of points that does not fit into the free memory.

    Parameters
    ----------
    count
        Number of points.
    held
        Number of the factors whose values are held in memory, and not made when they are asked for.

    Raises
    ------
    InputError
        With the number of points and what they need.
    """
    needed, free = count * (_POINT_BYTES + _FACTOR_BYTES * held), _free_memory()
    if needed > free:
        raise InputError(
            f"a list of {count:,} points needs about {needed / 1e9:,.3g} GB of memory, {free / 1e9:.3g} GB are free: "
            "use fewer levels or samples, or split the study"
        )


def _free_memory() -> int:
    """Bytes that programs can get without swapping; all memory of the machine where the system does not say."""
    try:
        text = Path("/proc/meminfo").read_text(encoding="ascii")
        available = next(line for line in text.splitlines() if line.startswith("MemAvailable:"))
        return int(available.split()[1]) * 1024
    except (OSError, StopIteration):
        return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
