from __future__ import annotations

import base64
import json
from html.parser import HTMLParser

import numpy as np
import pytest

from tripod_doe.errors import CubeError, InputError, StorageError
from tripod_doe.joint.parameters import JOINT_PARAMETERS
from tripod_doe.page_parts.tables import cost_rows, fixed_rows
from tripod_doe.reports import study_report
from tripod_doe.reports.study_report import make_page, write_report
from tripod_doe.study.cube.netcdf import write_dataset

OWN = ("initial_skew_1_deg", "roller_width_mm")
"""What the study of the joint gives itself: the paper names the one, the other is assumed."""

SECTIONS = [
    "findings",
    "effects",
    "waveforms",
    "spectrum",
    "region",
    "failed",
    "cost",
    "setting",
    "provenance",
    "reading",
]


class Page(HTMLParser):
    """Sections, rows of tables, identifiers and links of a page."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.sections: dict[str, str] = {}
        self.rows: list[tuple[str, list[str]]] = []
        self.ids: list[str] = []
        self.tags: set[str] = set()
        self.order: list[str] = []
        self.counts: dict[str, int] = {}
        self.links: list[str] = []
        self.downloads: dict[str, str] = {}
        self._section = ""
        self._cell = False
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        given = dict(attrs)
        self.tags.add(tag)
        self.counts[tag] = self.counts.get(tag, 0) + 1
        self.order.append(f"{tag}.{given['class'].split()[0]}" if given.get("class") else tag)
        if "id" in given:
            self.ids.append(given["id"])
        for key in ("href", "src", "xlink:href"):
            if key in given:
                self.links.append(given[key])
        if "download" in given:
            self.downloads[given["download"]] = given["href"]
        if tag == "section":
            self._section = given["id"]
            self.sections[self._section] = ""
        elif tag == "tr":
            self.rows.append((given.get("class") or "", []))
        elif tag in ("td", "th"):
            self.rows[-1][1].append("")
            self._cell = True

    def handle_endtag(self, tag):
        if tag in ("td", "th"):
            self._cell = False

    def handle_data(self, data):
        if self._section:
            self.sections[self._section] += data
        if self._cell:
            self.rows[-1][1][-1] += data

    def csv(self, name: str) -> str:
        kind, _, body = self.downloads[name].partition(",")
        assert kind == "data:text/csv;base64"
        return base64.b64decode(body).decode()


def test_every_section_is_there_with_numbers_of_the_cube(joint_page, joint_cube):
    page = Page(joint_page)
    assert list(page.sections) == SECTIONS
    third = joint_cube["thrust_amplitude"].sel(order=3)
    assert f"{float(third.mean()):.3g}" in page.sections["findings"]
    assert f"Largest third order: {float(third.max()):.3g} N" in page.sections["waveforms"].replace("\u00a0", " ")
    assert joint_cube.attrs["question"] in joint_page
    assert joint_cube.attrs["study_hash"] in page.sections["provenance"]
    assert joint_cube.attrs["kernel_source_hash"] in page.sections["provenance"]
    assert "values = [4, 8, 12]" in page.sections["provenance"]
    assert "made by a test" in page.sections["provenance"]
    for name, version in json.loads(joint_cube.attrs["package_versions"]).items():
        assert f"{name} {version}" in page.sections["provenance"]


def test_failed_points_are_listed_with_inputs_outcome_and_reason(joint_page, joint_cube):
    page = Page(joint_page)
    assert "12 of 24 points did not finish" in page.sections["failed"]
    reason = str(joint_cube["outcome_detail"].sel(needle_count=29).values[0, 0])
    assert reason
    listed = [cells for _, cells in page.rows if len(cells) == 6 and cells[1] == "jammed"]
    assert listed[0] == ["1", "jammed", reason, "4", "25", "29"]
    assert listed[-1] == ["23", "jammed", reason, "12", "200", "29"]
    assert len(listed) == 12


def test_no_more_than_fifty_failed_points_are_listed(make_cube):
    text = (
        '[study]\nname = "F"\nfunction = "report_functions:failing"\n[factors]\nx = { low = 0, high = 1, count = 70 }\n'
    )
    page = Page(make_page(make_cube(text), {}))
    listed = [cells for _, cells in page.rows if len(cells) == 4 and cells[1] == "error"]
    assert len(listed) == 50
    assert "70 of 70 points did not finish" in page.sections["failed"]
    assert listed[0][2] == "ValueError: no <b>answer</b> here"
    assert "b" not in page.tags


def test_every_value_has_the_source_that_it_has(joint_page, joint_cube):
    """What the study gives itself is its own, though the reference joint has it from the paper or assumed."""
    rows = {cells[0]: (mark, cells) for mark, cells in Page(joint_page).rows if cells and cells[0] in JOINT_PARAMETERS}
    fixed = json.loads(joint_cube.attrs["fixed_parameters"])
    assert set(fixed) <= set(rows)
    for name in fixed:
        parameter = JOINT_PARAMETERS[name]
        mark, cells = rows[name]
        source = "this study" if name in OWN else parameter.source
        assert (mark == "assumed") == source.startswith("assumed"), name
        assert cells[-1] == source
        assert cells[-2] == parameter.meaning
    assert rows["groove_radius_ratio"][1][1] == "1.0086"
    factors = ("joint_angle_deg", "torque_n_m", "needle_count")
    assert all(rows[name][1][-1] == "this study" for name in factors)
    count = sum(cells[-1].startswith("assumed") for _, cells in rows.values())
    assert f"{count} parameters are assumed" in " ".join(Page(joint_page).sections["setting"].split())


def test_the_source_of_a_value_is_the_study_only_where_it_sets_it(joint_cube):
    """Regression: groove_rolling_lever_mm was of "this study", which had set the roller radius alone."""
    study = '[study]\nname = "m"\n[base]\nroller_radius_mm = 15\n'
    cube = joint_cube.assign_attrs(
        study=study,
        fixed_parameters=json.dumps({"roller_radius_mm": 15, "groove_rolling_lever_mm": 15, "pitch_radius_mm": 21}),
    )
    sources = {row.name: row.source for _, rows in fixed_rows(cube) for row in rows}
    assert sources == {
        "roller_radius_mm": "this study",
        "groove_rolling_lever_mm": "as roller_radius_mm",
        "pitch_radius_mm": "assumed",
    }


def test_workers_are_those_that_ran_and_the_pilot_is_none_of_them(joint_cube):
    names = np.full(joint_cube["outcome"].shape, "0", dtype=object)
    names.ravel()[:3], names.ravel()[3:5] = "1", "pilot"
    cube = joint_cube.assign(worker=(joint_cube["outcome"].dims, names))
    rows = {what: (value, note) for what, value, note in cost_rows(cube)}
    assert rows["Workers"] == ("2", "0, 1")
    assert rows["Points from the pilot"] == ("2", "computed before, to choose the model")


def test_costs_are_sums_over_the_cube(joint_page, joint_cube):
    rows = {cells[0]: cells[1] for _, cells in Page(joint_page).rows if len(cells) == 3}
    assert rows["Steps"] == f"{float(joint_cube['steps'].sum()):,.0f}"
    assert rows["Workers"] == "1"
    cpu = float(joint_cube["cpu_seconds"].sum())
    value, unit = rows["CPU time"].split()[:2]
    assert float(value) * {"s": 1, "ms": 1e-3, "us": 1e-6}[unit] == pytest.approx(cpu, rel=6e-3)


def test_the_csv_behind_a_figure_equals_the_cube(joint_page, joint_cube, read_table):
    data = read_table(Page(joint_page).csv("thrust_amplitude_order_3-torque_n_m.csv"))
    third = joint_cube["thrust_amplitude"].sel(order=3, joint_angle_deg=8, needle_count=27)
    assert (data["torque_n_m"] == joint_cube["torque_n_m"].values).all()
    assert (data["thrust_amplitude_order_3[joint_angle_deg=8]"] == third.values).all()


@pytest.mark.parametrize("text", ["study = 3", "study = [1]\ndesign = 6\nbase = [2]\nfactors = 1", "study"])
@pytest.mark.usefixtures("charts_not_drawn")
def test_a_cube_whose_study_is_none_gives_a_page(make_cube, text):
    """Regression: of a cube that another program wrote, the report was a traceback."""
    cube = make_cube('[study]\nname = "A"\nfunction = "report_functions:line"\n[factors.x]\nvalues = [1, 2]\n')
    assert "study.toml" not in make_page(cube.assign_attrs(study=text), {})


def test_a_hostile_study_is_text_and_nothing_else(make_cube):
    evil = "</title><script>alert(1)</script><img src=x onerror=alert(2)>"
    cube = make_cube(
        f"[study]\nname = '{evil}'\nquestion = '{evil}'\nfunction = \"report_functions:line\"\n[factors]\nx = {{ values = [1, 2] }}\n"
    )
    text = make_page(cube, {})
    assert Page(text).counts["script"] == 1  # the page's own
    assert "img" not in Page(text).tags
    assert "&lt;script&gt;alert(1)" in text


def test_nothing_is_loaded_from_elsewhere_and_identifiers_are_unique(joint_page):
    page = Page(joint_page)
    assert all(link.startswith(("#", "data:text/csv", "data:image/png")) for link in page.links)
    assert not page.tags & {"link", "iframe", "object"}
    assert page.counts["script"] == 1
    for loader in ("@import", "url(http", "url(//", "src="):
        assert loader not in joint_page
    assert len(page.ids) == len(set(page.ids))
    targets = {link[1:] for link in page.links if link.startswith("#")}
    assert targets <= set(page.ids)


@pytest.mark.slow
def test_the_same_cube_gives_the_same_page(joint_page, joint_cube):
    assert make_page(joint_cube, {}) == joint_page


@pytest.mark.parametrize("part", [slice(0, 0), slice(0, 1)])
def test_a_cube_with_no_or_one_finished_point_gives_a_page(make_cube, part):
    text = '[study]\nname = "Few"\n[factors.joint_angle_deg]\nvalues = [5, 10]\n'
    page = Page(make_page(make_cube(text, part), {}))
    some = ["waveforms", "spectrum"] if part.stop else []
    assert list(page.sections) == [
        "findings",
        *some,
        *(["failed", "cost"] if part.stop else ["failed"]),
        "setting",
        "provenance",
        "reading",
    ]
    left = "1 of 2 points is not computed yet." if part.stop else "2 of 2 points are not computed yet."
    assert left in page.sections["findings"]
    assert "did not finish" not in page.sections["findings"]
    assert not [cells for _, cells in page.rows if "no reason recorded" in cells]


def test_the_function_of_a_study_is_not_needed_for_its_report(line_cube):
    elsewhere = line_cube.assign_attrs(study=line_cube.attrs["study"].replace("report_functions", "not_there"))
    rows = [cells for _, cells in Page(make_page(elsewhere, {})).rows if cells and cells[0] == "z"]
    assert rows[0][1] == "7"
    assert rows[0][4] == "argument of not_there:line"


def stored(cube, directory):
    write_dataset(cube, directory / "cube.nc")
    return directory


def test_a_report_is_written_whole_and_replaces_the_old_one(line_cube, tmp_path):
    (tmp_path / "report").mkdir()
    (tmp_path / "report" / "index.html").write_text("old")
    path = write_report(stored(line_cube, tmp_path))
    assert path == tmp_path / "report" / "index.html"
    assert path.read_text(encoding="utf-8").rstrip().endswith("</html>")
    assert {entry.name for entry in path.parent.iterdir()} == {"checksums.sha256", "index.html"}


def test_a_report_that_cannot_be_written_is_a_storage_error(line_cube, tmp_path):
    (tmp_path / "report").write_text("in the way")
    with pytest.raises(StorageError, match="cannot write this file"):
        write_report(stored(line_cube, tmp_path))


def test_missing_and_damaged_results_are_said_to_be_so(line_cube, tmp_path):
    with pytest.raises(CubeError, match="no such file"):
        write_report(tmp_path / "nothing")
    with pytest.raises(CubeError, match=r"no cube\.nc"):
        write_report(tmp_path)
    stored(line_cube, tmp_path)
    with pytest.raises(InputError, match="this is a file"):
        write_report(tmp_path / "cube.nc")
    (tmp_path / "analysis").mkdir()
    (tmp_path / "analysis" / "sobol.nc").write_bytes(b"not netCDF")
    with pytest.raises(CubeError, match=r"sobol\.nc"):
        write_report(tmp_path)
    assert not (tmp_path / "report").exists()


def test_a_report_of_results_that_changed_meanwhile_is_not_written(line_cube, tmp_path, monkeypatch):
    """Regression: `report` that began before a run ended wrote its page of the earlier results over the run's."""
    make, stored_there = study_report.make_page, stored(line_cube, tmp_path)

    def make_while_a_run_ends(*arguments):
        page = make(*arguments)
        stored(line_cube.assign_attrs(title="grown"), tmp_path)
        return page

    monkeypatch.setattr(study_report, "make_page", make_while_a_run_ends)
    with pytest.raises(InputError, match="another command changed these results"):
        write_report(stored_there)
    assert not (tmp_path / "report").exists()
