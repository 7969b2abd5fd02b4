"""The needle's loci: the study of the paper's Fig. 8(b), run and drawn."""

from __future__ import annotations

import numpy as np
import pytest

import tripod_doe as td
from tripod_doe.page_parts.charts.needle_locus import locus_chart


@pytest.fixture(scope="module")
def cube(tmp_path_factory):
    out = tmp_path_factory.mktemp("loci")
    assert td.run("studies/needle_between_plates.toml", out=out, progress=False).good
    return out


def test_the_three_loci_of_fig_8b(cube):
    """Published finding: straight for equal friction, to either side for unequal; FACTS gives 0.1393 mm."""
    drift = td.open_cube(cube)["axial_drift_mm"].values
    assert abs(drift[0]) < 1e-4
    assert drift[1] == pytest.approx(0.139307270, rel=3e-5)
    assert drift[2] == pytest.approx(-drift[1], rel=1e-6)


def test_the_report_draws_them(cube):
    chart = locus_chart(td.open_cube(cube))
    assert chart is not None
    data = td.open_cube(cube)
    np.testing.assert_array_equal(chart.data["drift_mm_2"], data["axial_path_mm"].isel(point=1))
    page = (cube / "report" / "index.html").read_text()
    assert "Fig. 8(b)" in page
    assert "Order spectrum" not in page
    assert locus_chart(data.drop_vars("axial_path_mm")) is None
