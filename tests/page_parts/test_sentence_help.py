"""Each kind of sentence that a page can state has an entry that explains it, and pages lead to these entries."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

import tripod_doe
from tripod_doe.page_parts.sentence_help import guide_entries, reading_of, readings
from tripod_doe.page_parts.templates import render

SOURCE = Path(tripod_doe.__file__).parent
STATED = [
    *SOURCE.glob("analyses/*/sentences.py"),
    *(SOURCE / "analyses" / name for name in ("findings.py", "main_effects/wording.py", "comparison/plausibility.py")),
    *(SOURCE / name for name in ("page_parts/subset.py", "model_interface/model_summary.py")),
]
FEWEST_WORDS = 4  # of its own; a template with fewer is a frame of others
GUIDE = Path(__file__).parents[2] / "docs" / "reference" / "reports.md"


def templates(path):
    """Whole sentences in the code of a module, with 0 for what is filled in."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.JoinedStr):
            text = "".join(part.value if isinstance(part, ast.Constant) else "0" for part in node.values).strip()
            if re.search(r"\.0?$", text) and len(re.findall(r"[a-z]{2,}", text)) >= FEWEST_WORDS:
                yield f"{path.parent.name}/{path.name}:{node.lineno}", text


SENTENCES = dict(pair for path in STATED for pair in templates(path))


def test_all_modules_with_sentences_are_read():
    assert len(STATED) > 15
    assert len(SENTENCES) > 90


@pytest.mark.parametrize("place", SENTENCES)
def test_every_sentence_of_the_code_has_an_entry(place):
    assert reading_of(SENTENCES[place]), f"{SENTENCES[place]!r}: write an entry in page_parts/sentence_help.toml"


@pytest.mark.parametrize(
    ("sentence", "key"),
    [
        ("Verdict on the third order: sure, since its value is known exactly.", "verdict"),
        ("Model rollers: typical error of the third order 0.96 % relative to model needles.", "model-error"),
        (
            "Model kinetostatic is outside its valid range here: swing_ratio = 4.4, valid up to 3; beyond, x.",
            "model-range",
        ),
        ("The third order of the thrust force is the largest: 14.4 N; the next is the ninth order.", "largest-order"),
        ("The third order lies between 1.4 N (at joint angle 2 deg) and 38.7 N (at joint angle 14 deg).", "range"),
        ("The second order is the same at all points: 0.2 N.", "range"),
        ("The third order is 14.4 N.", "range"),
        ("The third order is proportional to torque: 0.26 N per N m (100 to 300 N m; R2 > 0.9999).", "trend"),
        ("The third order decreases with speed, from 14.8 N (at 100 rpm) to 14.1 N (at 900 rpm).", "trend"),
        ("pull increases with groove sliding friction by 2.53 N per 0.01 (0.04 to 0.06; R2 = 0.99).", "trend"),
        ("By regression on all factors, the third order decreases with roller radius, by 0.003 N.", "regression"),
        (
            "Torque changes the second order by at most 2 % of its range, others at their base values.",
            "unresolved-trend",
        ),
        ("12 of 24 points did not finish: 12 jammed.", "failed"),
        ("With one friction alone switched off, the third order changes by: groove sliding -100 %.", "switched-off"),
        ("Of the third order (14.1 N), by Shapley value (its fair part): groove sliding 95.0 %.", "shares"),
        ("All of the third order depends on groove sliding: without it, less than 0.5 % is left.", "needs"),
        ("Direct decomposition of the third order: what each force adds. They need not agree.", "shares"),
        ("Total Sobol' indices of the third order: groove sliding friction 0.9 +- 0.1.", "sobol"),
        ("The probability that the third order exceeds 16 N is 9.4 % (6.4 to 14 %).", "exceedance"),
        (
            "For the third order, tighten groove sliding friction first: halving its scatter reduces it by 50 %.",
            "tighten",
        ),
        ("To keep the third order within 16 N with a probability of 99 %, halve the scatter of x.", "keep"),
        ("The measured third order is 14 +- 1 N, the model's 13 N: a difference of 1 N.", "compared-order"),
        ("Check the sign of the force: with the sign reversed, the record agrees better.", "doubts"),
        ("Groove sliding friction is 0.07 (0.06 to 0.08), with the intervals of 95 % confidence.", "fitted"),
        ("x is already known within 5 %. To know it better, measure at y.", "next-record"),
        ("Measure next at joint angle 4 deg: the interval of x becomes 28 % shorter.", "next-record"),
        ("The smallest third_order of 40 candidates is 16 +- 0.2 N, at pitch radius = 22 mm.", "best"),
        ("Of 40 candidates, 15 violate a limit.", "search-effort"),
        ("At the start of the search, size is 37 mm; the best is 36 mm (-3 %).", "best"),  # "uncertain shares"
        ("At the costs given, the cheapest way that these points resolve is: halve it, for 3 of 4.", "keep"),
        ("At 1 of 6 operating points the third order has no shares, since points did not finish.", "uncertain-shares"),
    ],
)
def test_a_sentence_leads_to_its_own_entry(sentence, key):
    assert reading_of(sentence).key == key


def test_what_a_user_wrote_has_no_entry():
    assert reading_of("Grease of Monday.") is None


def test_a_page_explains_its_sentences_and_no_others():
    sentence = "The probability that the third order exceeds 16 N is 9.4 % (6.4 to 14 %)."
    page = render(
        "overview.html",
        study="s",
        records=[],
        sentences=[sentence],
        charts=[],
        heads=[],
        rows=[],
        links=[],
        problems=[],
    )
    assert (
        re.findall(r'href="#reading-([\w-]+)"', page)
        == re.findall(r'<dt id="reading-([\w-]+)"', page)
        == ["exceedance"]
    )
    assert page.index('id="reading"') < page.index("</main>")


def test_the_guide_has_every_entry():
    """Made by: python -c "from tripod_doe.page_parts.sentence_help import guide_entries; print(guide_entries())"."""
    text = GUIDE.read_text(encoding="utf-8")
    assert text.partition("<!-- entries -->\n")[2].partition("<!-- end -->")[0].strip() == guide_entries().strip()


def test_keys_are_anchors_and_titles_are_unique():
    assert all(re.fullmatch(r"[a-z-]+", each.key) for each in readings())
    assert len({each.title for each in readings()}) == len(readings())
