"""Makes docs/pictures/vibration_map.svg from the result of its study; its numbers are inside.

tripod-doe run studies/vibration_map.toml --out results/vibration_map
python docs/pictures/vibration_map.py results/vibration_map > docs/pictures/vibration_map.svg
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pandas as pd

import tripod_doe as td
from tripod_doe.page_parts.charts.chart import ON_DARK, ON_LIGHT, Chart, drawing

ACROSS, UP, DAMPING = "groove_sliding_friction", "joint_angle_deg", "contact_damping_s_per_mm"
NAMES = {0.001: "dry contacts: 0.001 s/mm", 0.0: "greased contacts: 8e-6 s"}


def chart(directory: Path) -> Chart:
    """Where the joint vibrates, over joint angle and friction, a panel for each damping; cells hold the frequency."""
    cube, rows = td.open_cube(directory), []
    with drawing(7.4, 3.2) as (figure, axes):
        axes.remove()
        for number, (damping, name) in enumerate(NAMES.items()):
            panel = figure.add_subplot(1, 2, number + 1)
            part = cube.sel({DAMPING: damping}).transpose(UP, ACROSS, ...)
            vibrates, hertz = part["vibrates"].values, part["vibration_frequency_hz"].values
            panel.imshow(np.ma.masked_invalid(vibrates), cmap="Greys", vmin=0, vmax=1.4, aspect="auto", origin="lower")
            for row, column in np.ndindex(*vibrates.shape):
                shakes = vibrates[row, column] > 0
                text = f"{hertz[row, column]:.0f}" if shakes else "" if vibrates[row, column] == 0 else "?"
                colour = ON_DARK if shakes else ON_LIGHT
                panel.text(column, row, text, ha="center", va="center", fontsize=7, color=colour)
                place = (float(part[UP][row]), float(part[ACROSS][column]))
                rows.append((damping, *place, vibrates[row, column], hertz[row, column]))
            panel.set_xticks(range(part.sizes[ACROSS]), [f"{value:g}" for value in part[ACROSS].values])
            panel.set_yticks(range(part.sizes[UP]), [f"{value:g}" for value in part[UP].values])
            panel.grid(visible=False)
            panel.set_title(name, fontsize=9)
            panel.set_xlabel("groove sliding friction")
            panel.set_ylabel("joint angle (deg)")
    data = pd.DataFrame(rows, columns=[DAMPING, UP, ACROSS, "vibrates", "vibration_frequency_hz"])
    caption = "Where the joint vibrates by itself (dark, with the frequency in Hz), 100 N m and 1,000 rpm."
    return Chart("vibration-map", "Where the joint vibrates by itself", caption, figure, data)


def picture(directory: Path) -> str:
    """The chart as a file of its own; the comment holds its numbers, by which a test knows an outdated picture."""
    shown = chart(directory)
    return f"{shown.svg().removesuffix('</svg>')}<!--\n{shown.csv()}-->\n</svg>"


if __name__ == "__main__":
    print(picture(Path(sys.argv[1])))
