"""What stands where on a page: the answer first, sections only where they are filled, light and dark, wide and narrow."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from tripod_doe.analyses.claims.charts import claims_chart
from tripod_doe.analyses.claims.verdicts import ClaimsSettings, check_claims
from tripod_doe.analyses.main_effects.charts import effect_charts
from tripod_doe.analyses.sensitivity.charts import index_charts
from tripod_doe.analyses.stability.stability import RunKind
from tripod_doe.page_parts import templates
from tripod_doe.page_parts.answer import answer_first
from tripod_doe.page_parts.charts.chart import INK, VARIABLES
from tripod_doe.page_parts.words import spoken
from tripod_doe.reports.study_report import make_page, write_report
from tripod_doe.reports.workflow_report import StepView, chain_page
from tripod_doe.study.cube.netcdf import write_dataset

STYLE = (Path(__file__).parents[2] / "src" / "tripod_doe" / "page_parts" / "page.css").read_text()


def first_screen(page: str) -> str:
    """The part of a page before its contents."""
    return page[page.index("<header>") : page.index("<nav")]


@pytest.mark.slow
def test_question_answer_and_picture_come_before_everything_else(joint_page, joint_cube):
    first = first_screen(joint_page)
    assert first.index(joint_cube.attrs["question"]) < first.index('class="answer"') < first.index("<svg")
    assert first.count("<svg") == 1
    visible = re.sub(r"<details>.*?</details>", "", first, flags=re.DOTALL)
    told = re.findall(r"<p>(.*?)</p>", visible[visible.index('class="answer"') :])
    assert 1 <= len([text for text in told if text]) <= 3 + 1  # three sentences, and what the model leaves out
    assert "<table" not in first


def test_no_more_than_three_sentences_are_the_answer_and_none_is_lost():
    found = ["A is 1.5 N. B is 2 N.", "C holds (Fig. 3). D does not. E is open.", "F."]
    answer, more = answer_first(found)
    assert answer == ["A is 1.5 N.", "B is 2 N.", "C holds (Fig. 3)."]
    assert more == ["D does not. E is open.", "F."]
    assert answer_first(["A.", "B."]) == (["A.", "B."], [])


def test_a_page_has_only_the_sections_that_its_cube_can_fill(line_cube):
    page = make_page(line_cube, {})
    sections = re.findall(r'<section id="(\w+)"', page)
    assert sections == [
        "findings",
        "cost",
        "setting",
        "provenance",
        "reading",
    ]  # its only chart is the picture at the top
    contents = re.search(r"<nav.*?</nav>", page, re.DOTALL)[0]
    assert re.findall(r'href="#(\w+)"', contents) == sections[1:]
    assert "no analysed output" not in page
    assert "Orders" not in contents


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("contact_rate_per_s", "contact rate"),
        ("joint_angle_deg", "joint angle"),
        ("contact_damping_s_per_mm", "contact damping"),
        ("contact_damping_time_s", "contact damping time"),
        ("youngs_modulus_gpa", "Young's modulus"),
        ("poissons_ratio", "Poisson's ratio"),
    ],
)
def test_names_lose_their_whole_unit(name, words):
    assert spoken(name) == words


def test_plus_or_minus_is_one_sign():
    """Regression: "intervals of +−5 % of the largest index"."""
    assert (
        templates.typeset("2 +- 1 N, of +-5 %, from -3 to -2") == "2\u00a0±\u00a01\u00a0N, of ±5\u00a0%, from −3 to −2"
    )


def test_a_table_too_wide_to_stand_beside_its_figure_goes_below():
    """Regression: medians with quartiles of four definitions ended at the edge of the page, within the third."""
    (rule,) = re.findall(r"\.beside \{(.*?)\}", STYLE)
    assert "flex-wrap: wrap" in rule
    assert ".beside > .scroll { flex: 0 1 auto; max-width: 100%; }" in STYLE  # as wide as it needs, then scrolled


def test_reasons_parameters_and_provenance_are_folded(joint_page):
    for name in ("cost", "setting", "provenance"):
        part = joint_page[joint_page.index(f'<section id="{name}"') :]
        part = part[: part.index("</section>")]
        assert part.index("<details>") < part.index("<h2>") < part.index("<table")
        assert part.rstrip().endswith("</details>")


def test_every_colour_has_a_light_and_a_dark_value_and_none_stands_outside(joint_cube):
    light, dark = re.findall(r":root \{(.*?)\}", STYLE, re.DOTALL)
    names = [set(re.findall(r"--([\w-]+):", block)) for block in (light, dark)]
    assert names[0] == names[1]
    assert set(re.findall(r"var\(--([\w-]+)\)", STYLE)) <= names[0]
    assert set(VARIABLES.values()) <= names[0]
    assert "prefers-color-scheme: dark" in STYLE
    outside = STYLE.replace(light, "").replace(dark, "")
    assert not re.search(r"#[0-9a-fA-F]{3,6}\b|: *(white|black)\b", re.sub(r"#\w+ \{", "", outside))


def test_charts_take_their_colours_from_the_page(joint_cube):
    (chart, *_) = effect_charts(joint_cube)[0].charts
    drawn = chart.svg()
    assert f"var(--ink, {INK})" in drawn
    assert not re.search(rf"[: \"](?:{'|'.join(VARIABLES)})[;\"]", drawn)


def test_points_tell_their_numbers_where_the_pointer_rests(joint_cube):
    chart = next(chart for chart in effect_charts(joint_cube)[0].charts if chart.name.endswith("-torque_n_m"))
    titles = re.findall(r"<use [^>]*><title>(.*?)</title></use>", chart.svg())
    drawn = int(chart.data.iloc[:, 1:].notna().to_numpy().sum())
    assert len(titles) == drawn
    assert any("torque (N m): 200" in title for title in titles)


def test_every_figure_of_a_page_has_a_title(joint_page):
    figures = re.findall(r"<figure.*?</figure>", joint_page, re.DOTALL)
    assert len(figures) > 4
    assert all(re.search(r'<p class="title">\S', figure) for figure in figures)


def test_the_page_links_to_the_cube_and_its_cost(line_cube, tmp_path):
    costs = ["cpu_seconds", "wall_seconds", "steps", "force_evaluations", "solves", "simulated_seconds", "worker"]
    write_dataset(line_cube.drop_vars(costs), tmp_path / "cube.nc")
    write_dataset(line_cube[costs], tmp_path / "cost.nc")
    page = write_report(tmp_path).read_text(encoding="utf-8")
    assert 'href="../cube.nc"' in page
    assert 'href="../cost.nc"' in page
    assert 'href="../study.toml"' not in page  # it is not there


def test_interactions_have_a_chart_of_their_own(joint_cube):
    factors = ["joint_angle_deg", "torque_n_m", "needle_count"]
    pairs = np.full((3, 3), np.nan)
    pairs[0, 1], pairs[0, 2], pairs[1, 2] = 0.2, 0.01, -0.02
    single = {
        name: ("factor", np.full(3, value))
        for name, value in (("S1", 0.3), ("S1_conf", 0.02), ("ST", 0.5), ("ST_conf", 0.03))
    }
    result = xr.Dataset(
        single | {"S2": (("factor", "factor_2"), pairs), "S2_conf": (("factor", "factor_2"), np.full((3, 3), 0.05))},
        coords={"factor": factors, "factor_2": factors},
        attrs={"analysis_kind": "sobol", "outputs": "y"},
    )
    _, cells = index_charts(result, "sobol")
    assert cells.title.startswith("Interactions")
    assert cells.data[["factor", "factor_2", "S2"]].values.tolist() == [
        ["joint_angle_deg", "torque_n_m", 0.2],
        ["joint_angle_deg", "needle_count", 0.01],
        ["torque_n_m", "needle_count", -0.02],
    ]
    assert len(index_charts(result.drop_vars(["S2", "S2_conf"]), "sobol")) == 1


def test_claims_stand_against_their_limits_with_links_to_their_figures():
    claims = check_claims({}, ClaimsSettings())
    chart = claims_chart(claims)
    assert len(chart.data) == claims.sizes["claim"]
    assert chart.data["margin_percent"].notna().any()  # degrees of freedom need no study
    page = chain_page(
        "Paper",
        "Does it hold?",
        [StepView("claims", "claims", (), "finished")],
        notice="Quick. Changed: a = 1.",
        answers={"claims": claims},
        figures={"../steps/page/index.html#orders": "Fig. 13: orders"},
    )
    assert '<a href="../steps/page/index.html#orders">Fig. 13</a>' in page
    assert page.index("Does it hold?") < page.index('class="answer"') < page.index("<svg") < page.index("<table")
    folded = re.search(r'<details class="caution"><summary>(.*?)</summary><p>(.*?)</p>', page)
    assert (folded[1], folded[2]) == ("Quick", "Changed: a = 1.")


@pytest.mark.parametrize(("kind", "drawn"), [(RunKind.GOOD, 1), (RunKind.WRONG, 2)])
def test_panels_of_one_colour_are_told_and_not_drawn(borders_of, kind, drawn):
    chart = borders_of(kind)
    assert chart.svg().count("bdf2") == drawn - 1
    assert ("Not drawn, all runs right within the limit: bdf2." in chart.caption) == (drawn == 1)


@pytest.fixture
def borders_of():
    """The map of a study with two methods, of which one is right but for its last run of this kind."""
    from tripod_doe.analyses.stability.charts import stability_charts

    def make(kind):
        runs = np.full((2, 2, 3), int(RunKind.GOOD))
        runs[0, :, 2] = RunKind.WRONG
        runs[1, 0, 2] = kind
        case = ("method", "case")
        empty = np.full((2, 2), np.nan)
        data = xr.Dataset(
            {
                "run_kind": ((*case, "numerics"), runs),
                "error": ((*case, "numerics"), np.full((2, 2, 3), 0.001)),
                "run_outcome": ((*case, "numerics"), np.zeros((2, 2, 3), int)),
                "border_low": (case, empty),
                "border_high": (case, empty),
                "border_predicted": (case, empty),
                "ratio": (case, empty),
                "wrong_runs": (case, np.zeros((2, 2), int)),
            },
            coords={
                "method": ["rk4", "bdf2"],
                "varied": ("case", ["base", "load_n"]),
                "load_n": ("case", [1.0, 2.0]),
                "numerics": ("numerics", [1e-8, 1e-7, 1e-6]),
            },
            attrs={"numerics": "step_s", "limit": 0.02, "analysis_kind": "stability"},
        )
        return stability_charts(data)[0]

    return make


@pytest.fixture
def in_browser(chromium, tmp_path):
    """Show a page, as the file that it is, in a window of this width."""
    shown = []

    def show(page, width):
        path = tmp_path / "page.html"
        path.write_text(page, encoding="utf-8")
        shown.append(chromium.new_page(viewport={"width": width, "height": 800}))
        shown[-1].goto(path.as_uri())
        return shown[-1]

    yield show
    for page in shown:
        page.close()


@pytest.mark.slow
def test_nothing_is_cut_and_the_picture_is_on_the_first_screen(joint_page, in_browser):
    shown = in_browser(joint_page, 1280)
    for width in (1280, 400):
        shown.set_viewport_size({"width": width, "height": 800})
        assert shown.evaluate("innerWidth") == width
        assert shown.evaluate("document.documentElement.scrollWidth") <= width
        bottom = shown.evaluate("document.querySelector('.first svg').getBoundingClientRect().bottom")
        assert bottom <= 800 or width < 1280


@pytest.mark.slow
def test_a_click_on_a_head_sorts_and_another_one_turns_the_order(joint_page, in_browser):
    table = in_browser(joint_page, 1280).locator("#failed table").last
    orders = []
    for _ in range(2):
        table.evaluate("table => table.tHead.rows[0].cells[4].click()")  # the section is folded
        orders.append([float(cell) for cell in table.locator("tbody tr td:nth-child(5)").all_text_contents()])
    once, twice = orders
    assert len(set(once)) > 1
    assert once == sorted(once)
    assert twice == sorted(once, reverse=True)


def test_tables_stand_in_their_order_without_script(joint_page):
    part = joint_page[joint_page.index('<section id="failed"') :]
    assert part.index("<tbody>") < part.index("</table>")
    assert "sortable" in part
    assert joint_page.index("<script>") > joint_page.rindex("</table>")  # nothing on the page waits for it


def test_signs_and_phases_are_told_in_the_cube(joint_cube):
    assert "cos(k phi + p_k)" in joint_cube["thrust_phase_deg"].attrs["comment"]
    assert "positive along the input axis" in joint_cube["thrust"].attrs["comment"]
    assert joint_cube["rotation_deg"].attrs["comment"].startswith("0: the centre of roller 1")
