"""What a study needs in memory, from counts alone, before any point is made."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sized
from pathlib import Path

from tripod_doe.errors import InputError
from tripod_doe.study.definition import Factor, Study
from tripod_doe.study.file import DesignTable

__all__ = ["check_memory", "point_count", "refuse_too_many_points"]

_POINT_BYTES = 150  # fingerprint, constraint and order of a point, while they are made
_FACTOR_BYTES = 24  # a value of a point, with the copies while it is made


def refuse_too_many_points(study: Study) -> None:
    """Refuse a study whose list of points alone does not fit into the free memory; takes microseconds.

    Raises
    ------
    InputError
        With the number of points and what they need.
    """
    count = point_count(study)
    check_memory(
        count * (_POINT_BYTES + _FACTOR_BYTES * len(study.factors)),
        f"a list of {count:,} points",
        "use fewer levels or samples, or split the study",
    )


def check_memory(needed: int, what: str, remedy: str) -> None:
    """Refuse what needs more bytes than there are free.

    Raises
    ------
    InputError
        With what is needed, what is free, and the remedy.
    """
    free = _free_memory()
    if needed > free:
        raise InputError(f"{what} needs about {needed / 1e9:,.3g} GB of memory, {free / 1e9:.3g} GB are free: {remedy}")


def _free_memory() -> int:
    """Bytes that programs can get without swapping; all memory of the machine where the system does not say."""
    try:
        text = Path("/proc/meminfo").read_text(encoding="ascii")
        available = next(line for line in text.splitlines() if line.startswith("MemAvailable:"))
        return int(available.split()[1]) * 1024
    except (OSError, StopIteration):
        return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")


def point_count(study: Study) -> int:
    """Number of points of a study before constraints; 0 where only making them tells (a table), or refuses them."""
    return _count(study, study.file.design, study.factors)


def _count(study: Study, design: DesignTable, factors: Mapping[str, Factor]) -> int:
    if design.factors is not None and design.kind != "product":
        factors = {name: factors[name] for name in design.factors if name in factors}
    levels = [len(factor.values or ()) for factor in factors.values()]
    samples, width = design.samples or 0, len(factors)
    match design.kind:
        case "grid":
            return math.prod(levels)
        case "zip":
            return max(levels, default=0)
        case "one-at-a-time":
            return 1 + sum(levels)
        case "ablation":
            count = _switches(study, design, factors)
            return 2**count if design.combinations == "all" else 2 * count + 2
        case "product":
            parts = (study.file.designs[name] for name in design.of if name in study.file.designs)
            return math.prod(_count(study, part, study.factors) or 1 for part in parts if part.kind != "product")
        case "saltelli":
            return samples * (2 * width + 2 if design.second_order else width + 2)
        case "morris":
            return samples * (width + 1)
        case "table":
            return 0
        case _:
            return samples


def _switches(study: Study, design: DesignTable, factors: Sized) -> int:
    """Number of factors that an ablation switches."""
    return len(factors) if design.factors is not None else len(study.switches)
