"""The what-if part of a report in a browser without any network."""

from __future__ import annotations

import numpy as np
import pytest

import tripod_doe as td
from tripod_doe.analyses.surrogate.what_if_page import what_if_pages
from tripod_doe.cli import main
from tripod_doe.study.cube.lazy_dataset import read_dataset

STUDY = """
[study]
name = "Moved"
[factors]
joint_angle_deg = {low = 6, high = 12}
torque_n_m = {low = -90, high = 90}
initial_skew_1_deg = {low = -0.5, high = 0.4}
[design]
kind = "latin-hypercube"
samples = 24
[keep]
outputs = ["thrust_amplitude", "thrust_phase_deg"]
[responses.ratio]
formula = "thrust_amplitude[3] / (10 + abs(torque_n_m))"
[analysis.surrogate]
"""
PREDICT = """values => {
  const asked = document.querySelector('.what-if').whatIf, state = asked.state(values);
  return [Object.values(asked.predict(values)), state.quantities.map(each => [each.value, each.half])];
}"""
MOVE = """() => {
  const slider = document.querySelector('[data-factor=torque_n_m]'), took = [];
  for (let step = 0; step <= 20; step++) {
    slider.value = 9 * step - 90;
    const start = performance.now();
    slider.dispatchEvent(new Event('input'));
    took.push(performance.now() - start);
  }
  return took.sort((a, b) => a - b)[10];
}"""


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    folder = tmp_path_factory.mktemp("moved")
    (folder / "study.toml").write_text(STUDY)
    return td.run(folder / "study.toml", folder / "out", workers=0, progress=False).directory


@pytest.fixture
def offline(chromium, report):
    """The report as a file; an error of a script is an error of the test."""
    context = chromium.new_context(offline=True)
    page, faults = context.new_page(), []
    page.on("pageerror", lambda error: faults.append(str(error)))
    page.goto((report / "report" / "index.html").as_uri())
    yield page
    context.close()
    assert not faults


@pytest.mark.slow
def test_sliders_move_the_curves_and_the_numbers_are_those_of_python(offline, report):
    """Exact: components and bands to 1e-9 of their size, and nothing without torque; half of the moves take less than
    50 ms, drawing included."""
    asked = what_if_pages({"s": read_dataset(report / "analysis" / "surrogate.nc")})[0]
    for torque in (66.0, -31.0, 0.0):
        values = {"joint_angle_deg": 7.7, "torque_n_m": torque, "initial_skew_1_deg": 0.2}
        components, told = map(np.array, offline.evaluate(PREDICT, values))
        expected, answers = asked.surrogate.predict(asked.surrogate.encoded(**values))[0], np.array(asked.at(**values))
        assert np.abs(components - expected).max() <= 1e-9 * np.abs(expected).max()
        assert np.abs(told - answers).max() <= 1e-6 * np.abs(expected).max()  # float32 misses
    assert not told[:-1].any()  # no torque, no thrust; of a ratio nothing is known before
    curve = offline.locator(".what-if svg.wave path.line")
    before = curve.get_attribute("d")
    assert offline.evaluate(MOVE) < 50
    assert curve.get_attribute("d") != before
    largest = asked.surrogate.factors["torque_n_m"]["high"]
    assert float(offline.locator(".what-if output").nth(1).inner_text()) == pytest.approx(largest, rel=1e-3)
    assert offline.locator(".what-if table.nearest tbody tr").count() == 3
    shares = offline.locator(".what-if table.scatter tbody tr").nth(0).locator("td").all_inner_texts()
    assert all(share.endswith("%") for share in shares)


@pytest.mark.slow
@pytest.mark.parametrize(("width", "height"), [(1280, 900), (400, 800)])
def test_by_itself_its_sliders_are_on_the_first_screen_and_the_largest_order_is_first(chromium, report, width, height):
    assert main(["report", str(report), "--format", "what-if"]) == 0
    context = chromium.new_context(offline=True, viewport={"width": width, "height": height})
    page = context.new_page()
    page.goto((report / "report" / "what_if.html").as_uri())
    sliders = page.locator(".what-if input[type=range]")
    assert [sliders.nth(at).bounding_box()["y"] < height for at in range(3)] == [True] * 3
    assert page.locator(".what-if table.answers tbody th").first.inner_text() == "third order"
    before = page.locator(".what-if output").nth(1).inner_text()
    sliders.nth(1).focus()
    page.keyboard.press("End")
    assert page.locator(".what-if output").nth(1).inner_text() != before
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    context.close()


@pytest.mark.slow
def test_on_paper_and_without_scripts_it_still_says_something(chromium, report):
    context = chromium.new_context(offline=True, java_script_enabled=False)
    page = context.new_page()
    page.goto((report / "report" / "index.html").as_uri())
    page.emulate_media(media="print")
    told = page.locator(".what-if table.answers").inner_text()
    assert "third order" in told
    assert "±" in told
    assert not page.locator(".what-if .controls").is_visible()
    context.close()
