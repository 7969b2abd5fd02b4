"""Very large cubes: sentences and figures of a part that is told, counts of all points, nothing read twice."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

from tripod_doe.analyses.findings import find
from tripod_doe.page_parts import subset as parts
from tripod_doe.page_parts.subset import shown_subset, subset_sentences
from tripod_doe.page_parts.tables import failed_points
from tripod_doe.reports.study_report import make_page
from tripod_doe.study.cube import slab_reading
from tripod_doe.study.cube.slab_reading import all_finite, largest_magnitude

pytestmark = pytest.mark.usefixtures("charts_not_drawn")


@pytest.fixture
def few(monkeypatch):
    """Parts and slabs small enough for small cubes to have several."""
    monkeypatch.setattr(parts, "MOST_POINTS", 40)
    monkeypatch.setattr(slab_reading, "_SLAB_BYTES", 300)


def listed(count=200):
    x = np.linspace(0.0, 1.0, count)
    attrs = {"long_name": "x", "source": "this study", "units": "1"}
    outcome = np.zeros(count, np.int8)
    outcome[::20] = 1
    y = np.where(outcome == 0, 3 * x, np.nan)
    return xr.Dataset(
        {
            "y": ("point", y, {"long_name": "y", "units": "N"}),
            "course": (("point", "rotation_deg"), np.ones((count, 90))),
            "outcome": ("point", outcome),
            "outcome_detail": ("point", np.where(outcome == 0, "", "it broke").astype(object)),
        },
        coords={"x": ("point", x, attrs), "point": np.arange(count, dtype=np.int32)},
        attrs=dict.fromkeys(("title", "question", "study_hash", "source", "kernel_source_hash", "references"), "s")
        | {"study": '[study]\nname = "s"\n[design]\nkind = "sobol"\n'},
    )


def test_a_part_has_the_values_of_its_points(few, tmp_path):
    """Exact; read from a file in slabs it is the same as from memory, and courses stay in the file."""
    whole = listed()
    whole.to_netcdf(tmp_path / "cube.nc")
    with xr.open_dataset(tmp_path / "cube.nc", cache=False) as stored:
        part = shown_subset(stored)
        assert part.sizes["point"] == 40
        xr.testing.assert_equal(
            part.load().drop_vars("outcome_detail"), whole.isel(point=part["point"].values).drop_vars("outcome_detail")
        )
        assert not stored["y"].variable._in_memory
    assert part["outcome_detail"].values.tolist() == whole["outcome_detail"].values[part["point"].values].tolist()
    assert shown_subset(part).sizes["point"] == 40


def test_a_grid_is_thinned_along_its_longest_dimensions_and_keeps_their_ends(few):
    grid = xr.Dataset(
        {"outcome": (("a", "b", "c"), np.zeros((60, 9, 2), np.int8))},
        coords={"a": np.arange(60.0), "b": np.arange(9.0), "c": ["u", "v"]},
    )
    part = shown_subset(grid)
    assert part["outcome"].size <= 40
    assert part.sizes["c"] == 2
    for dim in ("a", "b"):
        assert part[dim].values[[0, -1]].tolist() == grid[dim].values[[0, -1]].tolist()
    assert subset_sentences(part) == [
        f"Sentences and figures on the points use {part['outcome'].size} of the 1,080 points (evenly spaced "
        "levels); counts, costs and analyses use all."
    ]


def test_a_page_says_what_it_is_made_of_and_counts_all_points(few):
    cube = listed()
    told = find(cube)
    assert any("40 of the 200 points (drawn at random with a fixed seed)" in sentence for sentence in told)
    assert any("10 of 200 points did not finish" in sentence for sentence in told)
    page = make_page(cube, {})
    assert "40 of the 200 points" in page
    assert "190" in page
    assert subset_sentences(shown_subset(listed(30))) == []


def test_a_part_of_several_models_has_all_points_by_the_truth(few):
    """Exact: 15 of 200 points are by the truth, which sentences on the joint are made of; 25 others are drawn."""
    level = np.where(np.arange(200) % 13 == 12, "fine", "rough").astype(object)
    study = '[study]\nname = "s"\n[factors.level]\nvalues = ["rough", "fine"]\n[design]\nkind = "multifidelity"\nfidelity = "level"\n'
    cube = listed().assign_coords(level=("point", level)).assign_attrs(study=study)
    part = shown_subset(cube)
    assert part.sizes["point"] == 40
    assert (part["level"].values == "fine").sum() == (level == "fine").sum() == 15
    assert "(all 15 by fine, others drawn at random with a fixed seed)" in subset_sentences(part)[0]


def test_failed_points_and_the_largest_number_are_those_of_all_points(few):
    cube = listed()
    assert [point.position for point in failed_points(cube, most=50)] == list(range(0, 200, 20))
    assert failed_points(cube, most=3)[2].inputs == ["0.201005"]
    y = cube["y"].variable
    assert largest_magnitude(-y) == float(y.max())
    assert np.isnan(largest_magnitude(y * np.nan))
    assert all_finite(y * cube["course"].variable).tolist() == (cube["outcome"].values == 0).tolist()
