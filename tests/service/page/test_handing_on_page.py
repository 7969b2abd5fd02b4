"""What is handed on from the page: a link and a joint in motion; and what is seen in the dark."""

from __future__ import annotations

import pytest

pytestmark = pytest.mark.slow


def test_a_link_is_made_opens_one_run_for_somebody_else_and_is_revoked(served, page, coast):
    page.goto(f"{served.home}/runs/{coast}")
    page.get_by_text("Share", exact=True).click()
    page.get_by_role("button", name="Make a link").click()
    field = page.get_by_label("Copy it now")
    field.wait_for()
    address = field.input_value()
    other = page.context.browser.new_context()
    try:
        seen = other.new_page()
        seen.goto(address)
        seen.get_by_role("heading", name="Coast and drive").wait_for()
        assert "share=" not in seen.url
        assert seen.get_by_role("navigation", name="Pages").get_by_role("link").count() == 0
        assert seen.get_by_text("Name, tags, note").count() == 0
        assert seen.get_by_role("button", name="Delete").count() == 0
        page.get_by_role("button", name="Revoke the link").click()
        page.locator("#share li").wait_for(state="detached")
        seen.reload()
        seen.get_by_role("heading", name="A token is needed").wait_for()
    finally:
        other.close()


def test_a_point_is_seen_in_motion(served, page, coast):
    page.goto(f"{served.home}/runs/{coast}?point=1")
    with page.expect_popup() as opened:
        page.get_by_role("link", name="See it move").click()
    moving = opened.value
    try:
        moving.locator("#scene-0").wait_for()
        moving.get_by_role("button", name="Play").click()
        moving.wait_for_timeout(500)
        assert int(moving.locator("body").get_attribute("data-frames")) > 0
    finally:
        moving.close()  # a joint that moves on takes half of a core
    page.get_by_text("The joint to scale").click()
    page.locator(".drawing svg").wait_for()


def test_the_model_is_chosen_from_a_list(served, page):
    page.goto(f"{served.home}/new?study=thrust_map")
    page.locator("#price dt", has_text="Points").wait_for(timeout=60_000)
    group = page.locator("details", has=page.locator("select[name='parameter.model']"))
    if group.get_attribute("open") is None:
        group.locator("summary").click()
    page.select_option("select[name='parameter.model']", "equilibrium")
    for _ in range(100):
        if 'model = "equilibrium"' in page.locator("#text").input_value():
            break
        page.wait_for_timeout(100)
    assert 'model = "equilibrium"' in page.locator("#text").input_value()


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_every_line_of_a_scale_is_seen_on_its_paper(served, page, coast, scheme):
    """A contrast of 3, that WCAG asks of graphics; the ends of the scale had 1.6 and 2.6."""
    page.emulate_media(color_scheme=scheme)
    page.goto(f"{served.home}/runs/{coast}")
    least = page.evaluate(
        """async () => {
          const place = document.querySelector("script[src*='/assets/'][type=module]").src.replace(/[^/]+$/, "theme.js");
          const { legible, contrast, colour } = await import(place);
          const parts = (hex) => [1, 3, 5].map((at) => parseInt(hex.slice(at, at + 2), 16));
          const scale = ["#255f8a", "#26648e", "#2a9187", "#6bb56b", "#c9c94f", "#d8d05f", "#1f3b73", "#fbe183"];
          return Math.min(...scale.map((hex) => contrast(parts(legible(hex)), parts(colour("--paper")))));
        }"""
    )
    assert least > 2.95
