"""The page as a person uses it: each test clicks through one thing that it is for."""

from __future__ import annotations

import base64
import csv
import io
import json
import re
import struct
import time
from datetime import UTC, datetime, timedelta, timezone
from pathlib import Path
from urllib.parse import parse_qsl, urlsplit

import numpy as np
import pytest
from axe_playwright_python.base import AXE_FILE_PATH

ROOT = Path(__file__).parents[3]
AXE = AXE_FILE_PATH.read_text(encoding="utf-8")
pytestmark = pytest.mark.slow

DRAWN = "#figure[data-drawn]"


def explore(page, served, run_id, query=""):
    page.goto(f"{served.home}/runs/{run_id}?{query}")
    page.wait_for_selector(DRAWN)


def until(page, expression, seconds=30):
    """Wait until an expression is true; Playwright's own way evaluates texts, which the page's policy stops."""
    for _ in range(10 * seconds):
        if page.evaluate(expression):
            return
        page.wait_for_timeout(100)
    raise AssertionError(expression)


def change(page, act):
    """Do something that draws the figure anew, and wait for it."""
    before = page.get_attribute("#figure", "data-drawn")
    act()
    until(page, f"document.getElementById('figure').dataset.drawn !== '{before}'")


def traces(page):
    return json.loads(page.evaluate("JSON.stringify(document.getElementById('figure').data)"))


def test_a_run_appears_and_ends_without_reload_and_goes_by_way_of_the_bin(served, page):
    """The live page as a person uses it: a submitted study shows up, moves, ends and goes, in one loaded document."""
    page.goto(served.home)
    page.evaluate("window.same = true")
    study = '[study]\nname = "Seen live"\n[factors.joint_angle_deg]\nvalues = [4, 8]\n'
    run_id = served.ask("POST", "/api/v1/runs", {"study": study})["id"]
    explorer, refused = page.context.new_page(), []
    explorer.on("response", lambda response: refused.append(response.url) if not response.ok else None)
    explorer.goto(f"{served.home}/runs/{run_id}")
    row = page.locator(f"#run-{run_id}")
    row.locator(".state.finished").wait_for(timeout=180_000)  # a run steps back behind everything else on a machine
    assert "2 of 2" in row.inner_text()
    explorer.wait_for_selector(DRAWN)
    explorer.close()
    assert not refused  # the explorer of a run without a point waits for one
    row.get_by_role("button", name="Delete").click()
    row.wait_for(state="detached")
    page.locator("#undo").get_by_role("button", name="Undo").click()
    row.wait_for()
    row.get_by_role("button", name="Delete").click()
    row.wait_for(state="detached")
    assert page.evaluate("window.same")
    page.get_by_role("link", name="Bin").click()
    row.get_by_role("button", name="Remove for good").click()
    page.get_by_role("button", name="Keep it").click()
    assert row.is_visible()
    row.get_by_role("button", name="Remove for good").click()
    page.locator("#sure").get_by_role("button", name="Delete").click()
    row.wait_for(state="detached")
    assert run_id not in [run["id"] for run in served.ask("GET", "/api/v1/runs")]


def test_a_run_is_found_by_a_word_or_a_tag_written_on_its_page(served, page, sampled):
    page.goto(f"{served.home}/runs/{sampled}/study")
    page.get_by_text("Name, tags, note").click()
    page.get_by_label("Name", exact=True).fill("customer/sampled")
    page.get_by_label("Tags, separated by commas").fill("steel, spring")
    page.get_by_label("Note").fill("Measured in **May**, [there](https://example.org). <b>Raw</b>")
    page.get_by_role("button", name="Save").click()
    page.get_by_role("heading", name="customer/sampled").wait_for()
    note = page.locator(".about-note")
    assert note.inner_text() == "Measured in May, there. <b>Raw</b>"
    assert note.locator("strong").inner_text() == "May"
    assert note.get_by_role("link", name="there").get_attribute("rel").startswith("noopener")
    page.goto(served.home)
    assert page.locator("table.runs tbody tr").count() >= 4
    assert "UTC" not in page.locator("table.runs time").first.inner_text()  # in the reader's zone
    page.get_by_label("Search").fill("measured may")
    until(page, "document.querySelectorAll('table.runs tbody tr').length === 1")
    until(page, "location.search.includes('text=measured+may')")
    page.reload()
    assert page.locator("table.runs tbody tr").count() == 1
    page.get_by_label("Search").fill("")
    page.get_by_label("Tag").select_option("steel")
    until(page, "document.querySelectorAll('table.runs tbody tr').length === 1")
    assert page.locator("table.runs .tag").all_inner_texts() == ["steel", "spring"]
    served.ask("PATCH", f"/api/v1/runs/{sampled}", {"name": "", "tags": [], "note": ""})


def test_last_weeks_run_among_200_in_three_actions(long_list, page):
    """By mouse and keys alone: a day, a word and a click; the day is one of the reader's zone, where it is another day."""
    hours = -12 if datetime.now(UTC).hour < 12 else 14
    clock = page.context.new_cdp_session(page)
    clock.send("Emulation.setTimezoneOverride", {"timezoneId": f"Etc/GMT{-hours:+}"})
    page.goto(long_list.door)
    assert "200 runs, page 1 of 4" in page.locator("#count").inner_text()
    page.get_by_role("link", name="next").click()
    page.get_by_text("page 2 of 4 previous next").wait_for()
    assert page.locator("table.runs tbody tr").count() == 50
    page.get_by_role("link", name="previous").click()
    page.get_by_label("Submitted from").click(position={"x": 12, "y": 12})  # its first part, the month
    page.keyboard.type(f"{datetime.now(timezone(timedelta(hours=hours))) - timedelta(days=7):%m%d%Y}")
    page.locator("#count").get_by_text("8 runs").wait_for()
    page.reload()
    assert "8 runs" in page.locator("#count").inner_text()
    page.get_by_label("Search").click()
    page.keyboard.type("customer-5")
    page.locator("#count").get_by_text("1 run", exact=True).wait_for()
    page.get_by_role("link", name="customer-5/joint 5").click()
    page.get_by_role("heading", name="customer-5/joint 5").wait_for()
    clock.send("Emulation.setTimezoneOverride", {"timezoneId": ""})


def test_an_answer_that_comes_late_does_not_replace_a_newer_one(long_list, page):
    """The answer to the first word is held back until the list shows that to the second."""
    page.goto(long_list.door)
    held = []
    page.route("**/parts/runs?*text=customer-1*", lambda route: held.append(route))
    with page.expect_request("**/parts/runs?*text=customer-1*"):
        page.get_by_label("Search").fill("customer-1")
    page.get_by_label("Search").fill("customer-5")
    page.locator("#count").get_by_text("10 runs", exact=True).wait_for()
    held[0].continue_()
    held[0].request.response().finished()
    page.wait_for_timeout(200)
    assert page.locator("#count").inner_text() == "10 runs"
    page.unroute_all()


def test_two_runs_side_by_side(served, page, coast, rungs, sampled, loaded):
    served.ask("PATCH", f"/api/v1/runs/{rungs}", {"name": "Coast and drive"})  # equal names are told apart
    for address in (f"runs/{sampled}", f"compare?run={coast}"):
        page.goto(f"{served.home}/{address}")
        assert f"Coast and drive ({rungs[:6]})" in page.locator("select option").all_inner_texts()
    served.ask("PATCH", f"/api/v1/runs/{rungs}", {"name": ""})
    page.goto(f"{served.home}/runs/{coast}")
    page.get_by_role("link", name="Compare with another run").click()
    page.locator("select[name=b]").select_option(rungs)
    page.get_by_role("button", name="Show").click()
    assert "they share 0." in page.locator("#points").inner_text()
    assert page.get_by_role("row", name="factors.model.values").is_visible()
    page.locator("select[name=b]").select_option(coast)
    page.get_by_role("button", name="Show").click()
    text = page.locator("#points").inner_text()
    assert "Equal there, wherever both have a number: thrust" in text
    assert text.endswith("The studies are equal.")
    page.goto(f"{served.home}/diff?a={coast}&b={loaded}")
    page.wait_for_selector(DRAWN)
    assert page.locator("#figure .main-svg").first.is_visible()
    assert "No picture" not in page.locator("#figure-note").inner_text()
    shadows = page.evaluate("getComputedStyle(document.querySelector('.scroll')).backgroundAttachment")
    assert shadows == "local, local, scroll, scroll"  # a box says that there is more
    page.locator("#results a").first.click()
    page.wait_for_selector(DRAWN)
    assert page.locator("[name=minus]").input_value() == coast


def test_controls_make_the_address_and_the_address_makes_the_view(served, page, coast):
    explore(page, served, coast)
    assert page.locator("[name=kind]:checked").get_attribute("value") == "lines"
    change(page, lambda: page.get_by_text("Map", exact=True).click())
    change(page, lambda: page.get_by_label("order", exact=True).select_option("6"))
    address = page.url
    chosen = parse_qsl(urlsplit(address).query)
    assert {("kind", "map"), ("select", "order=6"), ("select", "bearing_radial_clearance_mm=0.01")} <= set(chosen)
    seen = traces(page)
    page.goto(address)
    page.wait_for_selector(DRAWN)
    assert traces(page)[0]["z"] == seen[0]["z"]
    assert page.locator("#seen-title").inner_text().startswith("Thrust amplitude (N)")
    change(page, lambda: page.go_back())  # the order before
    assert page.get_by_label("order", exact=True).input_value() == "3"


def test_the_range_of_colours_stays_from_slice_to_slice(served, page, coast):
    explore(page, served, coast, "kind=map&x=joint_angle_deg&by=torque_n_m")
    before = [(trace["zmin"], trace["zmax"]) for trace in traces(page) if trace["type"] == "heatmap"]
    change(page, lambda: page.get_by_role("button", name="previous bearing radial clearance").click())
    after = [(trace["zmin"], trace["zmax"]) for trace in traces(page) if trace["type"] == "heatmap"]
    assert before == after
    assert before[0][1] > 10


def test_failed_cells_are_hatched_and_lead_to_their_reason(served, page, coast):
    explore(page, served, coast, "kind=map&x=joint_angle_deg&by=torque_n_m&select=bearing_radial_clearance_mm=-0.03")
    hatched = [trace for trace in traces(page) if "fillpattern" in trace]
    assert hatched[0]["fillpattern"]["shape"] == "/"
    reasons = next(trace["text"] for trace in traces(page) if trace.get("mode") == "markers")
    assert len(reasons) == 12
    assert all(reason.startswith("jammed: ") for reason in reasons)
    assert "12 of 12 points failed" in page.locator("#figure-note").inner_text()
    box = page.locator("#figure .nsewdrag").first.bounding_box()
    page.mouse.click(box["x"] + box["width"] / 2, box["y"] + box["height"] / 8)
    panel = page.locator("#point")
    panel.get_by_text("jammed").first.wait_for()
    assert "9 deg" in panel.inner_text()
    assert "bearing_radial_clearance_mm" in panel.locator(".caution").inner_text()


def test_a_number_leads_to_its_point_its_curve_and_the_same_point_again(served, page, coast):
    explore(page, served, coast)
    page.locator("#numbers summary").click()
    page.locator("#numbers [data-point]").nth(3).click()
    panel = page.locator("#point")
    panel.locator("#curve-figure .main-svg").first.wait_for()
    assert page.locator("#curve").input_value() == "thrust"
    assert "point=" in page.url
    assert "at=%7B%22joint_angle_deg" in page.url  # its values, by which it is found when the study has grown
    panel.get_by_text("Simulate again").click()
    panel.get_by_label("joint angle deg").fill("12")
    panel.get_by_role("button", name="Simulate").click()
    panel.get_by_text("Finished in").wait_for(timeout=60_000)
    names = page.evaluate("document.getElementById('curve-figure').data.map(trace => trace.name)")
    assert names[-1] == "again"
    panel.get_by_label("torque n m").fill("12,5")
    alone = "document.getElementById('curve-figure').data.every(trace => trace.name !== 'again')"
    assert page.evaluate(alone)  # regression: the curve of other values stayed
    panel.get_by_role("button", name="Simulate").click()
    panel.get_by_text("expected a number").wait_for()
    page.route("**/simulate", lambda route: (time.sleep(0.5), route.continue_()))
    panel.get_by_label("torque n m").fill("30")
    panel.get_by_role("button", name="Simulate").click()
    panel.get_by_label("torque n m").fill("60")
    until(page, "!document.querySelector('#again [type=submit]').disabled")
    assert page.evaluate(alone)


def test_what_is_copied_and_saved_are_the_numbers_that_are_seen(served, page, coast):
    explore(page, served, coast, "select=bearing_radial_clearance_mm=0.01")
    page.get_by_text("Copy as", exact=True).click()
    copies = page.locator("#exports pre").all_inner_texts()
    assert copies[0].startswith("tripod-doe query ")
    assert "--select order=3" in copies[0]
    assert "td.query(" in copies[1]
    assert "torque_n_m" in copies[2]
    page.keyboard.press("Escape")
    page.get_by_text("Save as", exact=True).click()
    with page.expect_download() as download:
        page.get_by_text("CSV, numbers of this view").click()
    rows = list(csv.DictReader(io.StringIO(download.value.path().read_text())))
    asked = served.ask(
        "GET",
        f"/api/v1/runs/{coast}/query?variable=thrust_amplitude&select=order=3&select=bearing_radial_clearance_mm=0.01",
    )
    assert [float(row["thrust_amplitude"]) for row in rows] == [row["thrust_amplitude"] for row in asked]
    with page.expect_download() as download:
        page.get_by_text("PNG, this picture").click()
    assert download.value.path().read_bytes().startswith(b"\x89PNG")


def test_a_difference_is_copied_and_saved_as_what_it_is_not(served, page, coast):
    """Commands and files hold the numbers before the subtraction, and say so."""
    explore(page, served, coast, "select=bearing_radial_clearance_mm=0.01&minus=bearing_radial_clearance_mm=-0.03")
    page.get_by_text("Copy as", exact=True).click()
    assert all(head.endswith(", without the subtraction") for head in page.locator("#exports h3").all_inner_texts())
    page.keyboard.press("Escape")
    page.get_by_text("Save as", exact=True).click()
    saved = page.locator("#exports a").all_inner_texts()
    assert saved[:2] == [
        "CSV, numbers of this view, without the subtraction",
        "netCDF, this view, without the subtraction",
    ]


def test_a_field_that_is_refused_keeps_its_complaint_and_its_study_from_running(served, page):
    page.goto(f"{served.home}/new")
    page.get_by_text("Geometry").click()
    pitch, run = page.locator("[name='parameter.pitch_radius_mm']"), page.get_by_role("button", name="Run this study")
    complaint = page.locator("#problems").get_by_text("pitch_radius_mm: 18,5")
    pitch.fill("18,5")
    pitch.press("Tab")
    complaint.wait_for()
    page.locator("[name='parameter.roller_radius_mm']").fill("15")
    until(page, "document.getElementById('text').value.includes('roller_radius_mm = 15')")
    page.locator("#price dt", has_text="Points").wait_for()
    assert complaint.is_visible()
    run.click()
    page.wait_for_timeout(1000)
    assert complaint.is_visible()
    assert page.url.endswith("/new")
    pitch.fill("18.5")
    pitch.press("Tab")
    complaint.wait_for(state="detached")
    until(page, "document.getElementById('text').value.includes('pitch_radius_mm = 18.5')")


def test_marks_on_parallel_axes_narrow_points_down(served, page, sampled):
    explore(page, served, sampled, "kind=parallel")
    note = page.locator("#figure-note")
    assert note.inner_text().startswith("40 points")
    box = page.locator("#figure canvas.over").bounding_box()
    page.mouse.move(box["x"] + 56, box["y"] + 60)  # on the first axis
    page.mouse.down()
    page.mouse.move(box["x"] + 56, box["y"] + 200, steps=4)
    page.mouse.up()
    kept = re.match(r"(\d+) of 40 points within the marks", note.inner_text())
    assert 5 < int(kept[1]) < 25  # the sample is even along each factor


@pytest.mark.parametrize("kind", ["parallel", "matrix"])
def test_finished_points_without_a_value_are_drawn(served, page, sampled, kind):
    explore(page, served, sampled, f"kind={kind}&where=joint_angle_deg < 8")  # the others are blank
    assert inked(page, "#figure canvas.base")
    assert page.locator("#complaint").inner_text() == ""


def test_filters_of_a_list_of_points_are_those_of_a_query(served, page, sampled):
    explore(page, served, sampled)
    low = page.locator("[data-range=torque_n_m] input").first
    change(page, lambda: (low.fill("100"), low.press("Enter")))
    assert "select=torque_n_m%3A" not in page.url
    assert ("select", "torque_n_m=100:") in parse_qsl(urlsplit(page.url).query)
    asked = served.ask(
        "GET", f"/api/v1/runs/{sampled}/query?variable=thrust_amplitude&select=order=3&select=torque_n_m=100:"
    )
    page.locator("#numbers summary").click()
    page.locator("#numbers tbody tr").first.wait_for()
    assert page.locator("#numbers tbody tr").count() == len(asked)


def test_a_wrong_condition_is_told_beside_it(served, page, coast):
    explore(page, served, coast)
    field = page.get_by_label("Only where")
    field.fill("thrust_amplitud > 3")
    field.press("Enter")
    until(page, "document.getElementById('complaint').textContent.includes('thrust_amplitude')")


def test_what_is_typed_stays_while_the_run_changes(served, page, sampled):
    """Regression: a field was replaced under the keys, and its half of a condition sent, at each change of the run."""
    explore(page, served, sampled, "kind=points")
    address, field = page.url, page.get_by_label("Only where")
    for name, half in (("changed", "joint_angle_deg <"), ("", " 1")):
        field.press_sequentially(half)
        typed = field.input_value()
        served.ask("PATCH", f"/api/v1/runs/{sampled}", {"name": name})
        until(page, f"document.querySelector('h1').textContent.includes('changed') === {str(bool(name)).lower()}")
        page.wait_for_timeout(500)
        assert (field.input_value(), page.url, page.locator("#complaint").inner_text()) == (typed, address, "")
    field.press_sequentially("3")
    change(page, lambda: field.press("Enter"))
    assert "where=joint_angle_deg+%3C+13" in page.url
    assert "kind=points" in page.url


def test_text_and_form_follow_each_other_and_complaints_stand_at_their_line(served, page):
    page.goto(f"{served.home}/new?study=thrust_map")
    page.locator("#price dt", has_text="Points").wait_for(timeout=60_000)
    assert "52" in page.locator("#price").inner_text()
    torque = page.get_by_label("torque (N m)")
    torque.fill("20, 40")
    torque.press("Tab")
    until(page, "document.getElementById('text').value.includes('values = [20, 40]')")
    page.locator("#price dd", has_text=re.compile("^26$")).wait_for(timeout=60_000)
    text = page.locator("#text")
    text.fill(text.input_value().replace("speed_rpm", "sped_rpm"))
    button = page.locator("#problems").get_by_role("button")
    button.wait_for()
    assert "speed_rpm" in page.locator("#problems").inner_text()
    assert page.get_by_role("button", name="Run this study").is_disabled()
    button.click()
    line = page.evaluate("(t => t.value.slice(t.selectionStart, t.selectionEnd))(document.getElementById('text'))")
    assert line.startswith("sped_rpm")
    text.fill('[study]\nname = "From the page"\n[base]\nspeed_rpm = 900\n[factors.joint_angle_deg]\nvalues = [5, 11]\n')
    until(page, "document.querySelector('[name=\"parameter.speed_rpm\"]').value === '900'")
    page.get_by_role("button", name="Run this study").click()
    page.wait_for_url("**/runs/*")
    page.get_by_role("heading", name="From the page").wait_for()


def test_a_study_that_is_run_at_once_is_the_one_that_is_seen(served, page):
    """Regression: a field left by the click on Run changed the text after it was submitted."""
    page.goto(f"{served.home}/new")
    text = page.locator("#text")
    text.fill('[study]\nname = "At once"\n[base]\nspeed_rpm = 900\n[factors.joint_angle_deg]\nvalues = [5, 11]\n')
    until(page, "document.querySelector('[name=\"parameter.speed_rpm\"]').value === '900'")
    until(page, "!document.getElementById('submit').disabled")
    submitted = []
    page.on("request", lambda r: submitted.append(r.post_data) if r.url.endswith("/api/v1/runs") else None)
    page.route("**/parts/change", lambda route: (time.sleep(0.5), route.continue_()))
    page.locator('[name="parameter.speed_rpm"]').fill("450")
    page.get_by_role("button", name="Run this study").click()
    page.wait_for_url("**/runs/*")
    assert [json.loads(body)["study"].count("speed_rpm = 450") for body in submitted] == [1]


def test_a_report_stands_in_a_sandbox(served, page, coast):
    page.goto(f"{served.home}/runs/{coast}/report")
    frame = page.frame_locator("iframe.report")
    frame.get_by_role("heading", name="Coast and drive").wait_for()
    assert page.locator("iframe.report").get_attribute("sandbox") == "allow-scripts allow-downloads"


def test_a_measurement_is_laid_over_a_point(served, page, coast):
    page.goto(f"{served.home}/compare?run={coast}")
    page.set_input_files("#table", ROOT / "measurements" / "run_up.csv")
    for name, value in (("joint_angle_deg", "9"), ("torque_n_m", "40"), ("bearing_radial_clearance_mm", "0.01")):
        page.select_option(f"[data-select={name}]", value)
    page.get_by_role("button", name="Compare").click()
    page.locator(".findings").get_by_text("measured third order").first.wait_for()
    until(page, "document.getElementById('waveform').data?.map(trace => trace.name).join() === 'measured,model'")
    assert page.locator("#table-of-orders tbody tr").count() == 13
    page.locator("#angle").fill("10,5")
    page.get_by_role("button", name="Compare").click()
    page.locator("#complaint", has_text="reference_angle: input should be a valid number").wait_for()
    assert page.locator("#findings, #table-of-orders, #waveform").all_inner_texts() == ["", "", ""]
    page.locator("#angle").fill("10.5")
    page.get_by_role("button", name="Compare").click()
    page.locator(".findings").get_by_text("measured third order").first.wait_for()
    until(page, "document.getElementById('waveform').data?.map(trace => trace.name).join() === 'measured,model'")


def test_a_comparison_stands_beside_nothing_but_what_it_is_of(served, page, coast, tmp_path):
    """Regression: it stayed when another point was chosen, came under another file, and did not name its point."""
    record = ROOT / "measurements" / "run_up.csv"
    page.goto(f"{served.home}/compare?run={coast}")
    page.set_input_files("#table", record)
    for name, value in (("joint_angle_deg", "9"), ("torque_n_m", "40"), ("bearing_radial_clearance_mm", "0.01")):
        page.select_option(f"[data-select={name}]", value)
    page.get_by_role("button", name="Compare").click()
    page.locator("#overview tbody tr").get_by_text("joint_angle_deg 9").wait_for()
    page.locator("#findings").get_by_text("measured third order").first.wait_for()
    page.select_option("[data-select=joint_angle_deg]", "")
    assert page.locator("#findings, #table-of-orders, #waveform, #overview").all_inner_texts() == [""] * 4
    asked = []
    page.route("**/compare", lambda route: (asked.append(route), time.sleep(0.5), route.continue_()))
    page.get_by_role("button", name="Compare").click()
    (tmp_path / "other.csv").write_bytes(record.read_bytes())
    page.set_input_files("#table", tmp_path / "other.csv")
    until(page, "!document.querySelector('#controls [type=submit]').disabled")
    assert len(asked) == 1
    assert page.locator("#findings, #table-of-orders, #waveform, #overview").all_inner_texts() == [""] * 4


def test_runs_that_are_chosen_are_those_of_the_address_after_going_back(served, page, coast, sampled):
    """Regression: the browser put back a choice that was made later, and another run was compared."""
    page.goto(f"{served.home}/compare?run={coast}")
    page.select_option("#run", sampled)
    page.wait_for_url(f"**/compare?run={sampled}")
    page.go_back()
    page.wait_for_url(f"**/compare?run={coast}")
    assert page.locator("#run").input_value() == coast
    page.goto(f"{served.home}/diff?a={coast}&b={coast}")
    page.select_option("[name=b]", sampled)
    page.get_by_role("button", name="Show").click()
    page.wait_for_url(f"**b={sampled}")
    page.go_back()
    page.wait_for_url(f"**b={coast}")
    assert page.locator("[name=b]").input_value() == coast


def test_several_files_with_umlauts_and_a_column_that_is_chosen(served, page, coast, tmp_path):
    """The record states its joint angle; two columns may be the force, of which one is chosen."""
    angle = np.arange(1440.0)
    rows = [f"{a:.1f};{14 * np.cos(np.radians(3 * a)):.4f};0".replace(".", ",") for a in angle]
    text = "\n".join(["Beugewinkel;9;°", "Drehwinkel;Axialkraft Gehäuse;Axialkraft Gerät", "°;N;N", *rows, ""])
    for name in ("a.asc", "b.asc"):
        (tmp_path / name).write_bytes(text.encode("latin-1"))
    page.goto(f"{served.home}/compare?run={coast}")
    page.set_input_files("#table", [tmp_path / "a.asc", tmp_path / "b.asc"])
    page.locator("#preview th", has_text="Axialkraft Gehäuse [N]").wait_for()
    page.locator("#complaint", has_text="may be thrust_n").wait_for()
    page.select_option("#column-thrust_n", "Axialkraft Gehäuse [N]")
    for name, value in (("torque_n_m", "40"), ("bearing_radial_clearance_mm", "0.01")):
        page.select_option(f"[data-select={name}]", value)
    page.get_by_role("button", name="Compare").click()
    page.locator("#overview tbody tr").nth(1).get_by_text("joint_angle_deg 9").wait_for()
    assert "\t14\t" in page.locator("#overview tbody tr").nth(1).inner_text()
    page.select_option("#column-rotation_deg", "")  # regression: "none" was not sent
    page.get_by_role("button", name="Compare").click()
    page.locator("#complaint", has_text="no column rotation_deg").wait_for()


def test_every_page_fits_a_narrow_window_and_speaks_to_every_reader(served, page, coast, sampled, shares):
    """axe looks for contrast, names of controls, order of headings and the like; in the dark for contrast."""
    page.set_viewport_size({"width": 400, "height": 800})
    for path in (
        "/",
        "/new",
        f"/runs/{coast}?point=3",
        f"/runs/{sampled}?kind=matrix&beside=kind%3Dpoints",
        f"/runs/{shares}/analyses",
        f"/runs/{coast}/failed",
        "/compare",
        "/runs/none",
    ):
        page.emulate_media(color_scheme="light")
        page.goto(served.home + path)
        if "point=" in path:
            page.locator("#point:not([hidden])").wait_for()
        if "beside=" in path:
            page.locator("#second-figure .main-svg").first.wait_for()
        assert page.evaluate("document.documentElement.scrollWidth") <= 400, path
        page.evaluate(f"{AXE}; 0")
        for scheme, rules in (("light", ""), ("dark", ", runOnly: ['color-contrast']")):
            page.emulate_media(color_scheme=scheme)
            asked = f"{{ resultTypes: ['violations']{rules} }}"  # what passes is not described
            found = page.evaluate(f"axe.run({{ exclude: ['iframe'] }}, {asked})")["violations"]
            assert [
                (fault["id"], fault["nodes"][0]["html"])
                for fault in found
                if fault["impact"] in ("serious", "critical")
            ] == [], (path, scheme)
            ground = page.evaluate("getComputedStyle(document.body).backgroundColor")
            assert (sum(map(int, re.findall(r"\d+", ground))) < 200) == (scheme == "dark")


def test_a_point_under_the_pointer_is_marked_in_all_views(served, page, sampled):
    """Points and a scatter matrix of them, one below the other; hovering marks the same point in both and its row."""
    explore(page, served, sampled, "kind=points&x=torque_n_m")
    page.locator("#numbers summary").click()
    page.locator("#numbers tbody tr").first.wait_for()
    page.get_by_role("button", name="Keep below").click()
    page.locator("#second-figure .main-svg").first.wait_for()
    change(page, lambda: page.get_by_text("Matrix", exact=True).click())
    page.locator("#numbers [data-point='17']").hover()
    below = page.locator("#second .ring:not([hidden])")
    below.wait_for()
    ring, dot = below.bounding_box(), page.locator("#second-figure .points path").nth(17).bounding_box()
    assert abs(ring["x"] + ring["width"] / 2 - dot["x"] - dot["width"] / 2) < 2
    assert abs(ring["y"] + ring["height"] / 2 - dot["y"] - dot["height"] / 2) < 2
    assert inked(page, "#figure canvas.over")
    page.locator("#second-figure").scroll_into_view_if_needed()
    dot = page.locator("#second-figure .points path").nth(5).bounding_box()
    page.mouse.move(dot["x"] + dot["width"] / 2, dot["y"] + dot["height"] / 2)
    page.locator("#numbers tr.marked [data-point='5']").wait_for(state="attached")
    address = page.url
    page.goto(address)
    page.locator("#second-figure .main-svg").first.wait_for()  # the view below stands in the address, too
    page.get_by_role("button", name="Swap").click()
    until(page, "document.querySelector('#second-figure canvas')")
    page.get_by_role("button", name="Close the view kept below").click()
    assert "beside" not in page.url


def inked(page, canvas):
    """Whether anything is drawn on a canvas."""
    return page.evaluate(
        f"(c => c.getContext('2d').getImageData(0, 0, c.width, c.height).data.some(Boolean))"
        f"(document.querySelector('{canvas}'))"
    )


def test_a_frame_in_the_scatter_matrix_narrows_points_down_and_a_mark_leads_to_its_point(served, page, sampled):
    explore(page, served, sampled, "kind=matrix")
    box = page.locator("#figure canvas.over").bounding_box()
    wide = (box["width"] - 68) / 4  # four quantities, beside the numbers of the axes
    left, top = box["x"] + 58, box["y"] + 8 + page.evaluate("document.getElementById('figure').points.up")
    page.mouse.move(left + 1, top + 1)  # the second row's first panel: torque over joint angle
    page.mouse.down()
    page.mouse.move(left + wide / 2 - 5, top + 400, steps=4)
    page.mouse.up()
    kept = re.match(r"(\d+) of 40 points within the mark", page.locator("#figure-note").inner_text())
    assert 15 < int(kept[1]) < 25  # half of an even sample
    x, y = page.evaluate(
        "(s => { const at = (k, v) => (v - s.axes[k].low) / (s.axes[k].high - s.axes[k].low);"
        " return [at(0, s.axes[0].values[7]), at(1, s.axes[1].values[7])]; })"
        "(document.getElementById('figure').points)"
    )
    height = page.evaluate("document.getElementById('figure').points.up") - 10
    page.mouse.click(left + 4 + x * (wide - 18), top + height - 4 - y * (height - 8))
    page.locator("#point").get_by_role("heading", name="Point 7").wait_for()


def test_a_number_of_an_analysis_leads_to_its_points(served, page, shares, sampled):
    page.goto(f"{served.home}/runs/{shares}")
    page.get_by_role("link", name="Analyses").click()
    row = page.locator("table.linked tr", has_text="13 deg").filter(has_text="groove rolling")
    row.locator("a").first.click()  # its share
    page.wait_for_selector(DRAWN)
    chosen = parse_qsl(urlsplit(page.url).query)
    assert {("x", "groove_rolling"), ("select", "joint_angle_deg=13"), ("select", "order=3")} <= set(chosen)
    assert len(traces(page)[0]["customdata"]) > 1
    page.goto(f"{served.home}/runs/{sampled}/analyses?order=6")
    page.locator("table.linked tr", has_text="0.95").locator("a").first.click()  # what is above this quantile
    page.wait_for_selector(DRAWN)
    page.locator("#numbers summary").click()
    page.locator("#numbers tbody tr").first.wait_for()
    assert page.locator("#numbers tbody tr").count() == 2  # of 40 points, 5 %
    assert "order 6" in page.locator("#seen-title").inner_text()
    explore(page, served, shares, "analysis=contribution")  # a mark in a figure of the analysis leads there, too
    page.locator("#numbers summary").click()
    page.locator("#numbers [data-point]").first.click()
    page.wait_for_url("**variable=thrust_amplitude**")


def test_the_difference_of_two_models_is_that_of_their_numbers(served, page, rungs):
    explore(page, served, rungs, "kind=map&x=joint_angle_deg&by=torque_n_m&select=model=kinetostatic&select=order=3")
    change(page, lambda: page.get_by_label("Subtract the values").select_option("model=equilibrium"))
    assert "less the value at model equilibrium" in page.locator("#seen-title").inner_text()
    drawn = unpack(traces(page)[0]["z"])
    asked = {
        (row["model"], row["torque_n_m"], row["joint_angle_deg"]): row["thrust_amplitude"]
        for row in served.ask("GET", f"/api/v1/runs/{rungs}/query?variable=thrust_amplitude&select=order=3")
    }
    wanted = [asked["kinetostatic", t, a] - asked["equilibrium", t, a] for t in (-40, 60) for a in (3, 8, 16)]
    assert drawn == pytest.approx(wanted, abs=1e-12)
    page.locator("#numbers summary").click()
    page.locator("#numbers tbody tr").first.wait_for()
    told = [float(text.replace(",", "")) for text in page.locator("#numbers td:nth-last-child(2)").all_inner_texts()]
    assert sorted(told) == pytest.approx(sorted(wanted), rel=1e-5)


def unpack(packed):
    return list(struct.unpack(f"<{len(data := base64.b64decode(packed['bdata'])) // 8}d", data))


def test_the_list_tells_the_extremes_of_the_chosen_order_and_leads_to_them(served, page, coast):
    page.goto(served.home)
    row = page.locator(f"#run-{coast}")
    page.get_by_label("Minimum and maximum of order").select_option("6")
    row.locator(".extremes [title*='order 6'] a").nth(1).wait_for()
    asked = served.ask("GET", f"/api/v1/runs/{coast}/query?variable=thrust_amplitude&select=order=6")
    largest = max(cell["thrust_amplitude"] or 0 for cell in asked)
    link = row.locator(".extremes a").nth(1)
    assert float(link.inner_text().split()[0]) == pytest.approx(largest, rel=0.01)
    number = [cell["thrust_amplitude"] for cell in asked].index(largest)
    assert link.get_attribute("href").endswith(f"?point={number}")


def test_the_price_of_a_point_is_told_before_it_is_simulated_and_its_contributions_are_a_study(served, page, coast):
    page.goto(f"{served.home}/runs/{coast}?point=5")
    panel = page.locator("#point")
    panel.get_by_text("Simulate again").click()
    panel.get_by_label("Another parameter").select_option("poissons_ratio")
    assert panel.get_by_label("Poisson's ratio").get_attribute("data-parameter") == "poissons_ratio"
    panel.get_by_label("Another parameter").select_option("model")
    panel.locator("[data-parameter=model]").fill("needles")
    status = panel.locator(".status")
    status.filter(has_text=re.compile(r"^About [\d.]+ (s|min) of CPU time")).wait_for()
    clearance = panel.locator("[data-parameter=bearing_radial_clearance_mm]")
    clearance.fill("-0.03")
    status.filter(has_text="This point will fail: jammed").wait_for()
    clearance.fill("0.02")
    panel.locator("[data-parameter=model]").fill("needels")
    status.filter(has_text="'needles'").wait_for()  # a wrong value is told before, too
    panel.get_by_text("Which friction makes the force here?").click()
    page.locator("#price dt", has_text="Points").wait_for()
    text = page.locator("#text").input_value()
    assert 'kind = "ablation"' in text
    assert "[analysis.contribution]" in text


def test_failed_points_of_a_workflow_lead_to_its_steps(served, page):
    """Regression: the number of failed points led to "name one of its steps"."""
    study = '[study]\nname = "bad"\n[factors.roller_width_mm]\nvalues = [11, 80]\n'
    workflow = '[workflow]\nname = "w"\n[steps.bad]\nkind = "study"\nstudy = "bad.toml"\n'
    asked = {"workflow": workflow, "files": {"bad.toml": study}}
    page.goto(f"{served.home}/runs/{served.ask('POST', '/api/v1/runs', asked)['id']}")
    page.get_by_role("link", name="1 failed").click(timeout=60_000)
    page.get_by_text("1 point ended as jammed").first.wait_for()
    assert page.url.endswith("/steps")


def test_a_workflow_of_the_gallery_comes_with_its_studies(served, page):
    page.goto(f"{served.home}/new")
    page.get_by_role("link", name="Small chain").click()
    page.locator(".of-steps th", has_text="friction").wait_for()
    assert page.get_by_role("button", name="Run this workflow").is_enabled()
    page.locator("[data-file='thrust_map.toml'] summary").click()
    field = page.locator("[data-file='thrust_map.toml'] textarea")
    field.fill(field.input_value().replace("[study]", "[studi]"))
    problem = page.locator("#problems").get_by_role("button", name="thrust_map.toml, line")
    problem.wait_for()
    problem.click()
    assert field.evaluate("field => field.value.slice(field.selectionStart, field.selectionEnd)") == "[studi]"
