"""Makes the pictures of docs/explanation/needles.md, from runs of `kinetostatic`; their numbers are inside.

python docs/pictures/needles.py docs/pictures
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pandas as pd

import tripod_doe as td
from tripod_doe.page_parts.charts.chart import COLOURS, LINES, MARKERS, Chart, drawing, legend_above

CLEARANCES = np.array([0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.35, 0.4, 0.5, 0.7, 1.0])
"""Axial clearances of a needle in mm."""
FRICTIONS = (0.03, 0.06)
"""Sliding friction coefficients of the needles."""
STARTS = (0.2, 0.5, 1.0)
"""Initial skews in degrees."""
CYCLES = 12


def stops() -> Chart:
    """Third order over the axial clearance, which decides how long needles are stopped."""
    data = {"needle_axial_clearance_mm": CLEARANCES}
    with drawing(4.7, 3.0) as (figure, axes):
        for which, friction in enumerate(FRICTIONS):
            data[f"thrust_amplitude_3_at_{friction:g}"] = amplitudes = np.array(
                [
                    float(
                        td.simulate(needle_axial_clearance_mm=room, needle_sliding_friction=friction)[
                            "thrust_amplitude"
                        ].sel(order=3)
                    )
                    for room in CLEARANCES
                ]
            )
            axes.plot(
                CLEARANCES,
                amplitudes,
                ls=LINES[which],
                marker=MARKERS[which],
                mfc="white",
                color=COLOURS[which],
                label=f"{friction:g}",
            )
        axes.set_xlabel("axial clearance of the needles (mm)")
        axes.set_ylabel("third order of the thrust (N)")
        legend_above(axes, 2, "sliding friction of the needles")
    caption = "Third order of the reference joint over the axial clearance of its needles."
    return Chart("needles_stops", "Stops of the needles", caption, figure, pd.DataFrame(data))


def skews() -> Chart:
    """Mean skew of the most loaded needle in every revolution, with and without stops in reach."""
    data = {"cycle": np.arange(1, CYCLES + 1)}
    with drawing(4.7, 3.4) as (figure, axes):
        for which, room in enumerate((0.2, 1.0)):
            for start in STARTS:
                run = td.simulate(needle_axial_clearance_mm=room, cycles=CYCLES, initial_skew_1_deg=start)
                summary = run["needle_skew_summary_deg"].sel(trunnion=1, statistic="mean").values
                data[f"skew_deg_from_{start:g}_at_{room:g}_mm"] = summary
                axes.plot(
                    data["cycle"],
                    summary,
                    ls=LINES[which],
                    marker=MARKERS[which],
                    mfc="white",
                    color=COLOURS[which],
                    label=f"{room:g} mm" if start == STARTS[0] else None,
                )
        axes.set_ylim(0, 1.05)
        axes.set_xlabel("revolution")
        axes.set_ylabel("mean skew of the most loaded needle (deg)")
        legend_above(axes, 2, "axial clearance of the needles")
    caption = "Skew over the revolutions from 0.2, 0.5 and 1 deg, with stops in reach (0.2 mm) and without (1 mm)."
    return Chart("needles_skew", "Skew that remains", caption, figure, pd.DataFrame(data))


if __name__ == "__main__":
    for chart in (stops(), skews()):
        text = f"{chart.svg().removesuffix('</svg>')}<!--\n{chart.csv()}-->\n</svg>\n"
        (Path(sys.argv[1]) / f"{chart.name}.svg").write_text(text, encoding="utf-8")
