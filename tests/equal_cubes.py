"""Compare the results of two versions value by value.

    python tests/equal_cubes.py OLD NEW [--relative 1e-9]

OLD and NEW are result directories, or folders of them. Every cube, analysis result and counted cost that both have is
compared: coordinates, numbers and flags. Texts (reasons of failures) are compared, too, but a better sentence is no
other result: they are listed and do not count. Measured seconds and names of workers are left out. The exit code is 1
where a value differs by more than `--relative`, or a variable is missing.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import xarray as xr

MEASURED = {"cpu_seconds", "wall_seconds", "worker"}


@dataclass(frozen=True)
class Difference:
    """How one variable of two files differs."""

    file: str
    variable: str
    what: str
    counts: bool = True

    def __str__(self) -> str:
        return f"{self.file}: {self.variable}: {self.what}"


def compare(old: xr.Dataset, new: xr.Dataset, file: str = "", relative: float = 0.0) -> Iterator[Difference]:
    """Differences of two datasets; nothing where all values are equal (NaN equals NaN)."""
    for name in sorted({str(name) for name in (*old.variables, *new.variables)} - MEASURED):
        if name not in new.variables:
            yield Difference(file, name, "is missing in the new one")
        elif name not in old.variables:
            yield Difference(file, name, "is new", counts=False)
        else:
            yield from _compare_variable(file, name, old.variables[name], new.variables[name], relative)


def _compare_variable(
    file: str, name: str, old: xr.Variable, new: xr.Variable, relative: float
) -> Iterator[Difference]:
    if old.dims != new.dims or old.shape != new.shape:
        yield Difference(file, name, f"{old.dims} {old.shape} became {new.dims} {new.shape}")
        return
    a, b = old.values, new.values
    if a.dtype.kind in "OUS" or b.dtype.kind in "OUS":
        for before, after in sorted({(str(x), str(y)) for x, y in zip(a.ravel(), b.ravel(), strict=True) if x != y}):
            yield Difference(file, name, f"{before!r} became {after!r}", counts=False)
        return
    a, b = a.astype(float), b.astype(float)
    apart = ~((a == b) | (np.isnan(a) & np.isnan(b)))
    if not apart.any():
        return
    with np.errstate(all="ignore"):
        error = np.abs(b - a) / np.nanmax(np.abs(a), initial=1e-300)
    appeared = int((np.isnan(a) != np.isnan(b)).sum())
    largest = float(np.nanmax(np.where(apart, error, 0.0), initial=0.0))
    what = f"{int(apart.sum())} of {apart.size} values differ, by at most {largest:.2g} of the largest"
    what += f"; {appeared} are missing in one of them" if appeared else ""
    yield Difference(file, name, what, counts=bool(appeared or largest > relative))


def compare_folders(old: Path, new: Path, relative: float = 0.0) -> tuple[list[str], list[Difference]]:
    """Files compared, and all their differences."""
    files = sorted(path.relative_to(old) for path in old.rglob("*.nc") if (new / path.relative_to(old)).exists())
    found: list[Difference] = []
    for file in files:
        with (
            xr.open_dataset(old / file, decode_cf=False) as before,
            xr.open_dataset(new / file, decode_cf=False) as after,
        ):
            found += compare(before, after, str(file), relative)
    return [str(file) for file in files], found


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("old", type=Path)
    parser.add_argument("new", type=Path)
    parser.add_argument(
        "--relative", type=float, default=0.0, help="allowed difference over a variable's largest value"
    )
    options = parser.parse_args()
    files, differences = compare_folders(options.old, options.new, options.relative)
    for difference in differences:
        print("" if difference.counts else "  (does not count) ", difference, sep="")
    wrong = {difference.file for difference in differences if difference.counts}
    print(f"{len(files)} files compared, {len(files) - len(wrong)} equal, {len(wrong)} different")
    return 1 if wrong or not files else 0


if __name__ == "__main__":
    sys.exit(main())
