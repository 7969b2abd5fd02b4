"""Fits and optimisations on the page, and runs that grow: priced beforehand, watched, and taken further."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

RIG = Path(__file__).parents[3] / "measurements" / "rig"
pytestmark = pytest.mark.slow

JOINT = """[optimisation]
name = "Bore of 25 needles"
[base]
model = "equilibrium"
needle_count = 25
[variables.needle_pitch_diameter_mm]
low = 16.2
high = 18
[variables.groove_radius_ratio]
low = 1.005
high = 1.02
[objectives.third]
output = "thrust_amplitude"
order = 3
[objectives.bore]
output = "needle_pitch_diameter_mm"
[search]
evaluations = 100
"""
FIT = """[fit]
name = "Friction of two records"
[base]
model = "equilibrium"
joint_angle_deg = 7
torque_n_m = 150
[unknowns.groove_sliding_friction]
low = 0.02
high = 0.15
[records]
files = ["*.csv"]
orders = [3]
"""


def until(page, expression, seconds=60):
    for _ in range(10 * seconds):
        if page.evaluate(expression):
            return
        page.wait_for_timeout(100)
    raise AssertionError(expression)


def run_file(page, served, text):
    page.goto(f"{served.home}/new")
    page.fill("#text", text)
    page.wait_for_selector("#submit:not([disabled]):has-text('Run this optimisation')")


def finish(page, served):
    page.click("#submit")
    page.wait_for_url(re.compile(r"/runs/\w+/"))
    page.wait_for_selector("#run-head .state.finished", timeout=120_000)


def test_an_optimisation_is_written_watched_and_taken(page, served):
    run_file(page, served, JOINT)
    assert page.is_hidden("#form")
    assert "at most 112" in page.inner_text("#price")
    finish(page, served)
    run_id = re.search(r"/runs/(\w+)", page.url)[1]
    page.goto(f"{served.home}/runs/{run_id}/steps")
    assert "100 of 100 candidates" in page.inner_text("#steps")
    assert "Best third" in page.inner_text("#steps")
    page.goto(f"{served.home}/runs/{run_id}")
    assert page.url.endswith("/result")
    assert page.locator("tr.marked .tag").inner_text() == "knee"
    page.goto(f"{served.home}/runs/{run_id}?step=front&kind=parallel")
    page.wait_for_selector("#figure[data-drawn]")
    assert "Drag along an axis" in page.inner_text("#figure-note")
    page.goto(f"{served.home}/runs/{run_id}/result")
    page.click("text=Take this one")
    page.wait_for_selector("#submit:not([disabled])")
    assert "needle_count = 25" in page.input_value("#text")
    assert page.inner_text("#submit") == "Run this study"
    served.ask("DELETE", f"/api/v1/runs/{run_id}")


def test_records_are_uploaded_and_fitted(page, served, tmp_path):
    """Names and encodings are those of a rig: a blank, an umlaut in Windows' encoding."""
    for number, name in ((1, "Messung 1.csv"), (2, "Messung 2.csv")):
        text = (RIG / f"record_{number}.csv").read_text()
        (tmp_path / name).write_bytes(f"# Prüfstand\n{text}".encode("cp1252"))
    page.goto(f"{served.home}/new")
    page.fill("#text", FIT)
    page.set_input_files("#files", [str(path) for path in sorted(tmp_path.glob("*.csv"))])
    page.wait_for_selector("#price:has-text('Records')")
    assert "Messung_1.csv, from Messung 1.csv" in page.inner_text("#attached")
    finish(page, served)
    run_id = re.search(r"/runs/(\w+)", page.url)[1]
    page.goto(f"{served.home}/runs/{run_id}")
    assert "Groove sliding friction" in page.inner_text(".findings")
    page.click("text=New study of this joint")
    page.wait_for_selector("#submit:not([disabled])")
    assert "groove_sliding_friction = 0.0" in page.input_value("#text")
    upload = served.ask("GET", f"/api/v1/runs/{run_id}/upload")
    assert upload["files"]["Messung_1.csv"].startswith("# Prüfstand\n")
    served.ask("DELETE", f"/api/v1/runs/{run_id}")


def test_a_run_grows_by_a_formula_and_by_a_level(page, served):
    study = """[study]
name = "Grows on the page"
[base]
model = "equilibrium"
[factors.joint_angle_deg]
values = [3, 8]
[factors.torque_n_m]
values = [-90, 140]
[keep]
outputs = ["thrust_amplitude"]
"""
    run_id = served.ask("POST", "/api/v1/runs", {"study": study})["id"]
    page.goto(f"{served.home}/runs/{run_id}")
    page.wait_for_selector("#run-head .state.finished", timeout=120_000)
    page.goto(f"{served.home}/runs/{run_id}")
    page.click("text=New variable by formula")
    page.fill("#derive [name=name]", "ratio")
    page.fill("#derive [name=formula]", "thrust_amplitude[3] / thrust_amplitud[6]")
    page.wait_for_selector("#derive .problems:has-text(\"did you mean 'thrust_amplitude'\")")
    page.fill("#derive [name=formula]", "thrust_amplitude[6] / thrust_amplitude[3]")
    page.wait_for_selector("#derive .price:has-text('No point runs')")
    page.click("text=Add the variable")
    page.wait_for_url("**variable=ratio*", timeout=120_000)
    page.wait_for_selector("#seen-title:has-text('Ratio')")
    held = []
    page.route("**/new_study.js", lambda route: held.append(route))  # the form is filled in first
    page.click("text=Extend", no_wait_after=True)
    page.fill("[name='parameter.joint_angle_deg']", "3, 8, 13")
    page.press("[name='parameter.joint_angle_deg']", "Tab")
    held[0].continue_()
    page.wait_for_selector("#price:has-text('New points')")
    until_new = "[...document.querySelectorAll('#price dd')].map((cell) => cell.innerText).slice(0, 2).join() === '2,6'"
    until(page, until_new)
    page.focus("[name='parameter.torque_n_m']")
    for torques, counts in (("-90, 140, 20", "5,9"), ("-90, 140", "2,6")):  # the field is not left
        page.fill("[name='parameter.torque_n_m']", torques)
        until(page, until_new.replace("2,6", counts))
    page.click("text=Run what is new")
    page.wait_for_url(f"**/runs/{run_id}")
    page.wait_for_selector("#run-head .state.finished", timeout=120_000)
    assert "6 of 6" in page.inner_text("#run-head")
    records = served.ask("GET", f"/api/v1/runs/{run_id}/query?variable=ratio")
    assert len(records) == 6
    page.goto(f"{served.home}/runs/{run_id}?variable=ratio")
    page.click("text=New variable by formula")
    page.click("#made [data-drop=ratio]")
    page.wait_for_url(f"{served.home}/runs/{run_id}", timeout=120_000)
    assert "ratio" not in served.ask("GET", f"/api/v1/runs/{run_id}/cube")["variables"]
    served.ask("DELETE", f"/api/v1/runs/{run_id}")
