"""Makes docs/pictures/thrust_map.svg, the picture of the README, from the result of its study; its numbers are inside.

tripod-doe run studies/thrust_map.toml --out results/thrust_map
python docs/pictures/thrust_map.py results/thrust_map > docs/pictures/thrust_map.svg
"""

from __future__ import annotations

import sys
from pathlib import Path

import tripod_doe as td
from tripod_doe.analyses.main_effects.charts import effect_charts
from tripod_doe.page_parts.charts.chart import Chart


def chart(directory: Path) -> Chart:
    """The third order over the joint angle, a line per torque: the chart that the report of the study has first."""
    return effect_charts(td.open_cube(directory))[0].charts[0]


def picture(directory: Path) -> str:
    """The chart as a file of its own; the comment holds its numbers, by which a test knows an outdated picture."""
    shown = chart(directory)
    return f"{shown.svg().removesuffix('</svg>')}<!--\n{shown.csv()}-->\n</svg>"


if __name__ == "__main__":
    print(picture(Path(sys.argv[1])))
