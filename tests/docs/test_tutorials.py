"""Every command and every Python block of tutorials and cookbook runs and prints what the page shows.

Pictures of the tutorials hold the numbers of the reports that they come from.
"""

from __future__ import annotations

import runpy

import matplotlib
import pytest

from executed_page import ROOT, difference, execute_page, near

PAGES = sorted(page for folder in ("tutorials", "cookbook") for page in (ROOT / "docs" / folder).glob("[0-9]*.md"))


REPORTS = runpy.run_path(str(ROOT / "docs" / "pictures" / "tutorial_reports.py"))
SLOW = ("3_first_question", "4_from_records_to_frictions", "5_from_tolerances_to_a_decision")


def marked(page):
    return pytest.param(page, id=page.stem, marks=[pytest.mark.slow] if page.stem in SLOW else [])


@pytest.mark.usefixtures("charts_not_drawn")
@pytest.mark.parametrize("page", [marked(page) for page in PAGES])
def test_a_page_runs_and_prints_what_it_shows(page, tmp_path, monkeypatch):
    """Regression: to 2 % of each number, or two units of its last digit."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(matplotlib, "use", lambda *args, **settings: None)
    execute_page(page)
    for picture, (report, figure) in REPORTS["PICTURES"].get(page.stem, {}).items():
        drawn = (ROOT / "docs" / "pictures" / f"{picture}.svg").read_text(encoding="utf-8")
        if figure:
            drawn, there = (
                drawn.partition("<!--\n")[2].partition("-->")[0],
                REPORTS["numbers"](tmp_path / report, figure),
            )
        else:
            there = REPORTS["picture"](tmp_path / report, figure)
        assert difference(drawn.replace(",", " "), there.replace(",", " ")) == "", picture


@pytest.mark.parametrize(
    ("shown", "printed", "same"),
    [
        ("a 1.23 N\n", "a  1.24 N\n", True),
        ("a 1.23 N\n", "a 1.33 N\n", False),
        ("a 1.23 N\n", "b 1.23 N\n", False),
        ("a 3\n", "a 4\n", False),  # counts are exact
        ("a\n", "a\nb\n", False),
        ("a\n...\n", "a\nb\n", True),
        ("...\nb\n", "a\nb\n", True),
        ("...\nc\n", "a\nb\n", False),
        ("took ... s\n", "took 3.2 s\n", True),
        ("order=3: 0.0021\n", "order=3: 0.0023\n", True),
        ("(1.5e-5)\n", "(1.6e-5)\n", True),
        ("a\n", "compiling kernels of rollers, once per version\ncompiled in 216 s\na\n", True),  # an empty cache
        ("a\n", "196 of 256 points (77 %) after 30.7 s, about 9.44 s left\na\n", True),  # a slow machine
    ],
)
def test_what_counts_as_the_same_output(shown, printed, same):
    assert (difference(shown, printed) == "") is same


def test_numbers_are_near_within_two_per_cent_or_two_last_digits():
    assert near("14.4", "14.6")
    assert not near("14.4", "14.8")
    assert near("-137", "-138")
    assert not near("12", "13")  # small whole numbers are counts
    assert near("28", "29")
    assert not near("28", "30")
    assert near("1,024", "1,030")
