"""Figures of the needles' skew: who keeps it, and what the choice of it changes."""

from __future__ import annotations

import numpy as np
import xarray as xr

from tripod_doe.analyses.claims.skew_charts import findings_over_skew_charts, kept_skew_charts
from tripod_doe.joint.orders import ORDERS

PLUS_MINUS = (1, -1, 1)


def cube_of(starts, ends, second, signs=PLUS_MINUS, **factors):
    """Points with these skews at the start and in the last revolution, and this second order of a third of 10 N."""
    count = len(starts)
    amplitude = np.zeros((count, ORDERS.size))
    amplitude[:, 3], amplitude[:, 2] = 10, second
    summary = np.array(ends)[:, None] * np.array(signs)
    labels = {f"initial_skew_{k + 1}_deg": np.array(starts) * signs[k] for k in range(3)} | factors
    return xr.Dataset(
        {
            "thrust_amplitude": (("point", "order"), amplitude),
            "needle_skew_summary_deg": (("point", "trunnion", "cycle", "statistic"), summary[:, :, None, None]),
            "outcome": ("point", np.zeros(count, np.int8)),
        },
        coords={"order": ORDERS, "statistic": ["mean"]}
        | {
            name: ("point", np.array(values, float), {"source": "paper", "units": "1"})
            for name, values in labels.items()
        },
    )


def test_the_bearing_that_keeps_its_skew_and_beats_is_named():
    cube = cube_of(
        starts=[1, 1, 2, 2], ends=[0.9, 0.2, 1.9, 2.4], second=[0.3, 0.1, 0.6, 0.3], needle_length_mm=[5, 10, 5, 10]
    )
    charts = kept_skew_charts(cube)
    assert [chart.name for chart in charts] == ["kept-1", "beat-1", "kept-2", "beat-2"]
    assert (
        "Of 2 bearings 1 keep it within 35 % and 0 have a second order of at least 5 % of the third; both: none."
        in (charts[0].caption)
    )
    assert "2 keep it within 35 % and 1 have" in charts[2].caption
    assert "both: needle length 5 (1.90 deg, 6.0 %)." in charts[2].caption
    assert "Bearings that keep every initial skew: needle length 5." in charts[0].caption
    assert charts[2].data["beat_percent"].tolist() == [6.0, 3.0]


def test_a_skew_that_changed_sides_is_not_kept():
    charts = kept_skew_charts(cube_of([1, 1], [-1, 1], [0.6, 0.6], needle_length_mm=[5, 10]))
    assert "both: needle length 10 (1.00 deg, 6.0 %)." in charts[0].caption


def test_findings_over_skew_draw_a_line_a_pattern():
    cube = xr.concat(
        [cube_of([0.2, 0.4], [0.3, 0.4], [0.1, 0.2]), cube_of([0.2, 0.4], [0.3, 0.4], [0.01, 0.02], (1, 1, 1))], "point"
    )
    orders, skews = findings_over_skew_charts(cube)
    assert "+ - +: second order 0.1 N at 0.2 deg, 0.2 N at 0.4 deg" in orders.caption
    assert "+ + +: second order 0.01 N at 0.2 deg" in orders.caption
    assert "+ - +: 0.2 to 0.30 deg, 0.4 to 0.40 deg" in skews.caption
    assert sorted(orders.data["pattern"].unique()) == ["+ + +", "+ - +"]


def test_without_needles_or_without_skew_there_is_nothing_to_draw(joint_cube):
    cube = cube_of([0, 0], [0.1, 0.1], [0.1, 0.1], needle_length_mm=[5, 10])
    assert kept_skew_charts(cube) == findings_over_skew_charts(cube) == []
    assert kept_skew_charts(joint_cube) == []
