"""What is handed on over HTTP: one page, workbooks, CSV with decimal commas."""

from __future__ import annotations

import io
from pathlib import Path
from shutil import copytree

import openpyxl
import pytest

import tripod_doe as td
from tripod_doe.errors import CubeError
from tripod_doe.service.workers import answers
from tripod_doe.study.result_directory.annotation import Annotation, write_annotation

pytestmark = pytest.mark.usefixtures("charts_not_drawn")


def test_a_run_on_one_page_and_as_a_workbook(api, coast):
    assert api.get(f"/runs/{coast}/summary.pdf").content.startswith(b"%PDF-")
    page = api.get(f"/runs/{coast}/summary.html")
    assert page.headers["content-security-policy"].startswith("sandbox ")
    assert "4 of 8 points finished" in page.text
    book = openpyxl.load_workbook(io.BytesIO(api.get(f"/runs/{coast}/summary.xlsx").content))
    assert len(list(book["Points"].values)) == 2 + 8
    assert api.get(f"/runs/{coast}/summary.doc").status_code == 422


def test_answers_for_spreadsheets(api, settings, coast):
    asked = {"variable": "thrust_amplitude", "select": ["order=3", "bearing_radial_clearance_mm=0.02"]}
    text = api.get(f"/runs/{coast}/query", params=asked | {"format": "csv", "decimal_comma": True}).text
    heads, *rows = [line.split(";") for line in text.splitlines()]
    values = td.query(settings.folder / coast, "thrust_amplitude", asked["select"])["thrust_amplitude"].values.ravel()
    at = heads.index("thrust_amplitude")
    assert [float(row[at].replace(",", ".")) for row in rows] == values.tolist()
    answer = api.get(f"/runs/{coast}/query", params=asked | {"format": "xlsx"})
    assert 'filename="answer.xlsx"' in answer.headers["content-disposition"]
    assert len(list(openpyxl.load_workbook(io.BytesIO(answer.content))["Answer"].values)) == 2 + len(rows)


def test_a_summary_is_of_the_results_that_are_there_now(coast, settings, tmp_path):
    directory = str(copytree(settings.folder / coast, tmp_path / "copy"))
    write_annotation(Path(directory), Annotation(note="for the meeting"))
    assert b"for the meeting" in answers.handed_on(directory, "html")
    cube = Path(directory) / "cube.nc"
    cube.write_bytes(cube.read_bytes()[:-1000])
    for form in ("html", "pdf", "xlsx"):
        with pytest.raises(CubeError):
            answers.handed_on(directory, form)
