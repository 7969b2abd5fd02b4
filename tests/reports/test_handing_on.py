"""What is handed on: one page for print and browsers, tables for spreadsheets, figures as files; same input, same bytes."""

from __future__ import annotations

import io
import re
import shutil
import struct
import xml.etree.ElementTree as ET
import zlib
from pathlib import Path

import openpyxl
import pytest
import xarray as xr

import tripod_doe as td
from tripod_doe.cli import main
from tripod_doe.errors import InputError
from tripod_doe.page_parts.charts.files import Paragraph, pdf_page
from tripod_doe.page_parts.xlsx_file import Sheet, workbook
from tripod_doe.service.routes.dependencies import IN_SANDBOX
from tripod_doe.study.cube.netcdf import write_dataset

STUDY = {
    "study": {"name": "Angles & <torques>", "question": "How does the thrust grow with $ and \u00e4ngle?"},
    "base": {"model": "equilibrium", "initial_skew_1_deg": 0.3},
    "factors": {"joint_angle_deg": {"values": [4, 8, 12]}, "bearing_radial_clearance_mm": {"values": [0.01, -0.05]}},
    "keep": {"outputs": ["thrust_amplitude", "groove_thrust_amplitude", "energy_residual", "thrust"]},
}


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    folder = tmp_path_factory.mktemp("handed") / "out"
    td.run(STUDY, folder, workers=0, progress=False)
    return folder


def handed(results, form, *words):
    assert main(["report", str(results), "--format", form, *map(str, words)]) == 0
    names = {"pdf": "summary.pdf", "html": "summary.html", "xlsx": "tables.xlsx"}
    return (results / "report" / names[form]).read_bytes()


@pytest.mark.slow
def test_one_page_for_print_is_one_sheet_of_a4_with_text_as_text(results):
    data = handed(results, "pdf")
    assert data == handed(results, "pdf")
    assert data.startswith(b"%PDF-")
    assert re.findall(rb"/Type /Page\b", data) == [b"/Type /Page"]
    box = [float(word) for word in re.search(rb"/MediaBox \[([^\]]*)\]", data)[1].split()]
    assert box[2] / box[3] == pytest.approx(210 / 297, rel=1e-3)
    assert b"/Subtype /Image" not in data  # the chart stays lines and letters
    streams = re.findall(rb"stream\r?\n(.*?)\r?\nendstream", data, re.DOTALL)
    drawn = b"".join(zlib.decompress(part) for part in streams if part[:1] == b"x")
    assert drawn.count(b"Tj") + drawn.count(b"TJ") > 20


def test_one_page_for_browsers_says_question_answer_and_source(results):
    page = handed(results, "html").decode()
    assert "Angles &amp; &lt;torques&gt;" in page
    assert page.count('class="lead"') <= 3
    assert page.count("<svg") == 1
    assert "3 of 6 points finished" in page
    assert "<script" not in page


def test_one_page_says_who_wrote_what_about_it(results):
    """A long note is cut: the page stays one."""
    note = "# Steel\n\n- **by hand** [here](https://example.org)\n- <b>raw</b>\n\n" + "word " * 900
    assert main(["annotate", str(results), "--owner", "Ada & co", "--tags", "audi,old", "--note", note]) == 0
    page = handed(results, "html").decode()
    about = re.findall(r'<p class="about">(.*?)</p>', page)
    assert about[:4] == [
        "Owner: Ada &amp; co; Tags: audi, old",
        "Steel",
        "\u2022 by hand here",
        "\u2022 &lt;b&gt;raw&lt;/b&gt;",
    ]
    assert about[4].endswith(" \u2026")
    assert sum(map(len, about)) < 1000
    data = handed(results, "pdf")
    assert re.findall(rb"/Type /Page\b", data) == [b"/Type /Page"]
    assert main(["annotate", str(results), "--owner", "", "--tags", "", "--note", ""]) == 0


def test_a_page_without_a_chart_is_printed_without_a_warning():
    """Regression: matplotlib warned in the PDF of a study in which all points failed (warnings are errors here)."""
    assert pdf_page([Paragraph("No point finished.")], None, [], "a").startswith(b"%PDF")


def test_the_workbook_has_units_widths_and_provenance(results):
    book = openpyxl.load_workbook(io.BytesIO(handed(results, "xlsx")))
    assert book.sheetnames == ["Points", "Parameters", "Provenance", "Study"]
    rows = list(book["Points"].values)
    heads, units = rows[0], rows[1]
    assert heads[:4] == ("joint_angle_deg", "bearing_radial_clearance_mm", "outcome", "outcome_detail")
    third = heads.index("thrust_amplitude[3]")
    assert (units[0], units[third]) == ("deg", "N")
    cube = td.open_cube(results)
    written = [float("nan") if row[third] is None else row[third] for row in rows[2:]]
    stored = cube["thrust_amplitude"].sel(order=3).values.ravel()
    assert written == pytest.approx(stored.tolist(), rel=1e-15, nan_ok=True)  # a workbook has 16 digits
    assert [row[2] for row in rows[2:]] == ["finished", "jammed"] * 3
    assert "groove_thrust_amplitude[2, 3]" in heads
    assert not [head for head in heads if head.startswith("thrust[")]
    assert book["Points"].column_dimensions["B"].width > 20
    told = dict(list(book["Provenance"].values)[1:])
    assert told["study_hash"] == cube.attrs["study_hash"]
    assert "numpy" in told
    assert 'name = "Angles & <torques>"' in [row[0] for row in book["Study"].values]


def test_numbers_of_an_analysis_are_sheets_by_their_dimensions(tmp_path):
    """Exact: the numbers of the cube of the analysis, without those along a revolution."""
    study = {
        "study": {"name": "s"},
        "base": {"model": "equilibrium"},
        "factors": {"torque_n_m": {"low": 20, "high": 60}, "groove_sliding_friction": {"low": 0.02, "high": 0.1}},
        "design": {"kind": "saltelli", "samples": 16},
        "keep": {"outputs": ["thrust_amplitude", "thrust"]},
        "analysis": {"sobol": {}},
    }
    td.run(study, tmp_path / "out", workers=0, progress=False)
    book = openpyxl.load_workbook(io.BytesIO(handed(tmp_path / "out", "xlsx")))
    analysis = td.open_cube(tmp_path / "out" / "analysis" / "sobol.nc")
    heads, _, *rows = next(rows for sheet in book if "S1_conf" in (rows := list(sheet.values))[0])
    dims = analysis["S1"].dims
    at = {name: heads.index(name) for name in (*dims, "S1")}
    for row in rows:
        value = float(analysis["S1"].sel({dim: row[at[dim]] for dim in dims}))
        assert (row[at["S1"]] is None) == (value != value)
        assert row[at["S1"]] is None or row[at["S1"]] == pytest.approx(value, rel=1e-15)
    assert not any("rotation_deg" in next(iter(sheet.values)) for sheet in book)


@pytest.mark.parametrize("words", [[], *(["--format", form] for form in ("pdf", "html", "xlsx", "figures"))])
def test_a_result_without_points_has_no_report(tmp_path, capsys, words):
    """Regression: an internal error, for an analysis that is a step of a workflow."""
    result = xr.Dataset({"mean": ("order", [1.0])}, {"order": [3]}, {"analysis_kind": "tolerance"})
    write_dataset(result, tmp_path / "cube.nc")
    assert main(["report", str(tmp_path), *words]) == 2
    assert "the result of an analysis of kind tolerance, without the points of a study" in capsys.readouterr().err
    (tmp_path / "r.csv").write_text("rotation_deg,thrust_n\n0,1\n")
    assert main(["compare", str(tmp_path), str(tmp_path / "r.csv")]) == 2
    assert "without the points of a study" in capsys.readouterr().err


def test_texts_of_strangers_are_no_formulas_and_names_of_sheets_are_free():
    rows = [("=1+1", float("nan")), ("http://a.example", 2), ("\x1b[2J\x00", float("inf")), ("{=A1}", None)]
    book = openpyxl.load_workbook(
        io.BytesIO(workbook([Sheet("a/b:" + "c" * 60, ("x", "y"), rows), Sheet("A", "x", []), Sheet("a", "x", [])]))
    )
    assert [cell.data_type for cell in book.worksheets[0]["A"]] == ["s"] * 5
    assert [cell.hyperlink for cell in book.worksheets[0]["A"]] == [None] * 5
    assert [row[1] for row in book.worksheets[0].values] == ["y", None, 2, None, None]
    assert len({name.lower() for name in book.sheetnames}) == 3
    with pytest.raises(InputError, match="select fewer, or take a CSV file"):
        workbook([Sheet("a", ["x"] * 20_000, [])])


@pytest.mark.slow
def test_each_figure_is_an_svg_and_a_png(results, tmp_path):
    assert main(["report", str(results), "--format", "figures", "--output", str(tmp_path / "out")]) == 0
    files = sorted((tmp_path / "out").iterdir())
    assert {file.stem for file in files if file.suffix == ".svg"} == {f.stem for f in files if f.suffix == ".png"}
    page = (results / "report" / "index.html").read_text()
    assert len(files) == 2 * len(re.findall(r'class="data" download="[^"]*\.csv"', page))
    for file in files:
        if file.suffix == ".svg":
            assert ET.parse(file).getroot().tag.endswith("svg")
            assert "var(--" not in file.read_text()
        else:
            assert file.read_bytes().startswith(b"\x89PNG")


def test_answers_of_a_query_for_spreadsheets(results, tmp_path, capsys):
    words = ["query", str(results), "--variable", "thrust_amplitude", "--select", "order=3"]
    assert main([*words, "--format", "csv", "--decimal-comma"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].split(";")[:2] == ["joint_angle_deg", "bearing_radial_clearance_mm"]
    assert re.fullmatch(r"4,0;0,01;3;\d+,\d+;finished", lines[1])
    assert main([*words, "--decimal-comma"]) == 2
    assert "--decimal-comma: the format is table" in capsys.readouterr().err
    assert main([*words, "--output", str(tmp_path / "a.xlsx")]) == 0
    book = openpyxl.load_workbook(tmp_path / "a.xlsx")
    assert [list(row)[:3] for row in list(book["Answer"].values)[:2]] == [
        ["joint_angle_deg", "bearing_radial_clearance_mm", "order"],
        ["deg", "mm", None],
    ]
    assert dict(list(book["Provenance"].values)[1:])["select"] == "order=3"


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--output", "a.doc"], "end the name in .pdf, .html or .xlsx"),
        (["--output", "a.pdf", "--format", "xlsx"], "but --format is xlsx"),
    ],
)
def test_names_that_contradict_the_format_are_refused(results, capsys, words, message):
    assert main(["report", str(results), *words]) == 2
    assert message in capsys.readouterr().err


def test_the_report_draws_the_joint_and_names_the_command_that_moves_it(results):
    page = (results / "report" / "index.html").read_text()
    assert 'aria-label="The joint to scale: pitch radius 21' in page
    assert "The first point: joint_angle_deg = 4, bearing_radial_clearance_mm = 0.01." in page
    assert "tripod-doe view DIR --select joint_angle_deg=4 --select bearing_radial_clearance_mm=0.01" in page


@pytest.mark.slow
def test_a_report_in_a_sandbox_saves_its_figures(results, chromium, tmp_path):
    """As the service shows it: without the rights of its origin."""
    outside = tmp_path / "frame.html"
    address = (results / "report" / "index.html").as_uri()
    outside.write_text(
        f'<iframe sandbox="allow-scripts allow-downloads" src="{address}" width="1000" height="700"></iframe>'
    )
    window = chromium.new_context(accept_downloads=True)
    page = window.new_page()
    page.goto(outside.as_uri())
    for kind in ("SVG", "PNG"):
        with page.expect_download() as found:
            page.frame_locator("iframe").get_by_role("button", name=f"Save this figure as {kind}").first.click()
        data = Path(found.value.path()).read_bytes()
        assert found.value.suggested_filename.endswith(kind.lower())
        if kind == "SVG":
            root = ET.fromstring(data)
            assert "var(--" not in data.decode()
        else:
            width, height = struct.unpack(">II", data[16:24])
            box = [float(word) for word in root.get("viewBox").split()]
            assert width == 1800
            assert width / height == pytest.approx(box[2] / box[3], rel=1e-2)
    window.close()


@pytest.mark.slow
def test_a_report_moves_two_of_its_points_under_the_policy_of_the_service(results, chromium, tmp_path):
    copy = tmp_path / "out"
    shutil.copytree(results, copy)
    chosen = ["--select", "bearing_radial_clearance_mm=0.01", "--select", "joint_angle_deg=4,12"]
    assert main(["report", str(copy), "--motion", *chosen]) == 0
    report = (copy / "report" / "index.html").read_text()
    assert len(report) - len((results / "report" / "index.html").read_text()) < 2_100_000  # a megabyte a revolution
    policy = IN_SANDBOX["content-security-policy"].replace("frame-ancestors 'self'", "")
    meta = f'<meta http-equiv="Content-Security-Policy" content="{policy.partition(";")[2]}">'
    (tmp_path / "served.html").write_text(report.replace("<head>", f"<head>{meta}", 1))
    (tmp_path / "frame.html").write_text(
        '<iframe sandbox="allow-scripts allow-downloads" src="served.html" width="1000" height="900"></iframe>'
    )
    window = chromium.new_context(offline=True)
    page = window.new_page()
    page.goto((tmp_path / "frame.html").as_uri())
    shown = page.frame_locator("iframe")
    shown.locator("h2", has_text="The joint in motion").scroll_into_view_if_needed()
    shown.locator("body").evaluate("() => document.querySelector('#motion').scrollIntoView()")
    moving = shown.frame_locator("iframe.motion")
    moving.get_by_role("button", name="Play").click()
    moving.locator("body:not([data-frames='0'])").wait_for()
    assert "normal forces" in moving.locator("#numbers-1").inner_text()
    window.close()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--motion"], "the selection leaves 6 points; choose one or two, for instance --select joint_angle_deg=4"),
        (["--motion", "--format", "pdf"], "only the report itself shows a joint in motion, not --format pdf"),
        (["--select", "joint_angle_deg=4"], "give --motion, too"),
    ],
)
def test_motion_in_a_report_says_what_to_choose(results, words, message, capsys):
    assert main(["report", str(results), *words]) == 2
    assert message in capsys.readouterr().err
