"""Makes docs/choosing.md from the results of two workflows, which take about half an hour of CPU time.

tripod-doe workflow workflows/speed_accuracy.toml --out results/speed_accuracy --workers 1
tripod-doe workflow workflows/stability.toml --out results/stability
python docs/choosing.py results/speed_accuracy results/stability $(git rev-parse --short HEAD) > docs/choosing.md
"""

from __future__ import annotations

import sys
from pathlib import Path

import tripod_doe as td
from tripod_doe.report.choosing_page import choosing_page


def main(speed: Path, stability: Path, commit: str) -> None:
    """Print the page."""
    borders = sorted(stability.glob("steps/*_borders/cube.nc"))
    print(
        choosing_page(
            td.open_cube(speed / "steps/accuracy/cube.nc"),
            {path.parent.name.removesuffix("_borders"): td.open_cube(path) for path in borders},
            commit,
        ),
        end="",
    )


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]), sys.argv[3])
