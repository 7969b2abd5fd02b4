"""The page of a joint in motion, painted by a browser without a network or a graphics card."""

from __future__ import annotations

import re

import numpy as np
import pytest
from axe_playwright_python.sync_playwright import Axe

from tripod_doe.motion_page.page import motion_page, viewed_point

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def point():
    return viewed_point(torque_n_m=-60, joint_angle_deg=14, initial_skew_1_deg=0.4, samples_per_revolution=72)


@pytest.fixture
def moving(chromium, tmp_path, point):
    """The page as a file in a narrow window, in the dark; and its errors."""
    (tmp_path / "joint.html").write_text(motion_page(point), encoding="utf-8")
    window = chromium.new_context(viewport={"width": 400, "height": 800}, color_scheme="dark", offline=True)
    page, errors = window.new_page(), []
    page.on("pageerror", lambda error: errors.append(str(error)))
    page.on("request", lambda request: request.url.startswith("file:") or errors.append(request.url))
    page.goto((tmp_path / "joint.html").as_uri())
    yield page, errors
    window.close()
    assert errors == []


def test_forces_that_are_shown_are_those_of_the_point(moving, point):
    page, _ = moving
    for _ in range(10):
        page.keyboard.press("ArrowRight")
    page.locator("#numbers-0", has_text="rotation 50.0 deg").wait_for()
    text, outputs = page.locator("#numbers-0").inner_text(), point.outputs
    assert float(re.search(r"thrust (-?[\d.]+) N", text)[1]) == pytest.approx(outputs["thrust"].data[10], abs=0.006)
    for words, name in (
        ("normal forces", "groove_normal_force"),
        ("friction", "groove_friction_force"),
        ("slip", "groove_slip"),
        ("pressures", "groove_pressure_mpa"),
    ):
        shown = [float(n) for n in re.search(words + r" ([\d., ]+) ", text)[1].split(", ")]
        assert shown == pytest.approx(outputs[name].data[:, 10], abs=0.51), name
    assert page.evaluate("document.documentElement.scrollWidth") <= 400
    assert Axe().run(page).violations_count == 0
    place = page.locator("#cursor-0").bounding_box()["x"] - page.locator("#plot-0").bounding_box()["x"]
    wide = page.evaluate("document.getElementById('plot-0').clientWidth")
    assert place == pytest.approx(46 + (wide - 56) * 10 / 72, abs=1.5)


def test_every_view_paints_another_picture_and_keys_move_it(moving):
    page, _ = moving
    picture = "document.getElementById('scene-0').toDataURL()"
    seen = set()
    for key in ["1", "2", "3", "4", "5", "6", "+", "End", "ArrowRight"]:
        page.keyboard.press(key)
        page.wait_for_timeout(60)
        seen.add(page.evaluate(picture))
    assert len(seen) == 8  # End is no key of the page
    page.get_by_label("tilt, skew, clearances").select_option("20")
    page.wait_for_timeout(60)
    assert page.evaluate(picture) not in seen
    page.locator("body").click(position={"x": 5, "y": 5})
    page.keyboard.press(" ")
    page.wait_for_timeout(400)
    page.keyboard.press(" ")
    page.get_by_role("button", name="Play").wait_for()
    assert int(page.locator("body").get_attribute("data-frames")) > 2
    ratio = page.evaluate(
        """() => { const scene = document.getElementById("scene-0"), pixels = scene.getContext("2d").getImageData(0, 0, scene.width, scene.height).data;
        const paper = pixels.slice(0, 3).join(); let other = 0;
        for (let i = 0; i < pixels.length; i += 4) other += pixels.slice(i, i + 3).join() !== paper;
        return other / (pixels.length / 4); }"""
    )
    assert 0.1 < ratio < 0.95
    assert np.isfinite(ratio)


def test_outlines_are_those_of_the_bodies(moving):
    """Exact geometry: outlines of rollers and cylinders hold all points of the bodies, and nothing beyond."""
    page, _ = moving
    wrong = page.evaluate(
        """() => {
      const g = document.createElement("canvas").getContext("2d"), wrong = [], scale = 7, r = 60, half = 25, long = 80;
      for (let n = 0; n < 40; n++) {
        const { cast } = cameraOf(0.3 * n, 0.07 * n - 1.4, scale, 0.2 * n, [0, 0, 0], [0, 0]), axis = unit([1, 0.1 * n - 2, 0.5]);
        const first = unit(cross(axis, [0, 0, 1])), second = cross(axis, first), own = cast(axis), bodies = { roller: [], cylinder: [] };
        for (let i = 0; i <= 80; i++) {
          for (let j = 0; j < 90; j++) {
            const x = half * (i / 40 - 1), rim = Math.sqrt(r * r - x * x), round = add(scaled(first, Math.cos(j * Math.PI / 45)), second, Math.sin(j * Math.PI / 45));
            bodies.roller.push(cast(add(scaled(axis, x / scale), round, rim / scale)));
            bodies.cylinder.push(cast(add(scaled(axis, (long * (i / 40 - 1)) / scale), round, r / scale)));
          }
        }
        for (const [name, points] of Object.entries(bodies)) {
          g.beginPath();
          if (name === "roller") roller(g, [0, 0], r, half, own, scale);
          else cylinder(g, scaled(own, -long / scale), scaled(own, long / scale), r, own, scale);
          for (let d = 0; d < 24; d++) {
            const [x, y] = [Math.cos(d * Math.PI / 12), Math.sin(d * Math.PI / 12)];
            const most = points.reduce((best, p) => (x * p[0] + y * p[1] > x * best[0] + y * best[1] ? p : best));
            if (!g.isPointInPath(0.99 * most[0], 0.99 * most[1]) || g.isPointInPath(1.01 * most[0], 1.01 * most[1])) wrong.push([name, n, d]);
          }
        }
      }
      return wrong;
    }"""
    )
    assert wrong == []
