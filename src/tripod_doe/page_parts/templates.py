"""Pages from the templates next to this module, and typographic signs in their sentences."""

import base64
import re
from functools import cache

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from tripod_doe.number_text import number, size
from tripod_doe.page_parts.charts.chart import Chart
from tripod_doe.page_parts.markdown import markdown
from tripod_doe.page_parts.sentence_help import reading_of, readings

_TO_READING = re.compile(r'<a class="why" href="#reading-([\w-]+)"')
_MOST_BYTES = 10_000_000
_LARGE = {
    re.compile(r'<a class="data" [^>]*>Data \(CSV\)</a>'): "Its data are",
    re.compile(r"<svg role=.*?</svg>", re.DOTALL): "This figure is",
}
"""Optional parts of a page, and the subject of the sentence that reports a part left out."""


@cache
def _templates() -> Environment:
    environment = Environment(
        loader=PackageLoader("tripod_doe.page_parts", "."),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.globals["reading_of"] = reading_of
    environment.filters |= {
        "number": number,
        "typeset": typeset,
        "markdown": markdown,
        "csv_link": _csv_link,
        "svg": _svg,
    }
    return environment


def render(template: str, **content: object) -> str:
    """A page from one of the templates, of at most 10 MB; text is escaped, charts are drawn inline.

    Sentences that `sentence_help.toml` explains lead to their explanation, at the end of the page: it is read anywhere.
    """
    page = _templates().get_template(template).render(**content)
    if used := set(_TO_READING.findall(page)):
        shown = [each for each in readings() if each.key in used]
        section = _templates().get_template("sentence_help.html").render(readings=shown)
        page = page.replace("</nav>", '  <a href="#reading">How to read</a>\n</nav>', 1)
        page = f"{section}</main>".join(page.rsplit("</main>", 1))
    return _of_limited_size(page)


def _of_limited_size(page: str) -> str:
    """A page that is not too large: without its largest data tables, then figures if needed; the page says so."""
    for part, subject in _LARGE.items():
        for block in sorted(part.findall(page), key=len, reverse=True):
            if len(page.encode()) <= _MOST_BYTES:
                return page
            page = page.replace(block, f"{subject} left out: this page would be larger than {size(_MOST_BYTES)}.")
    return page


def typeset(text: str) -> str:
    """Plain-text sentences with typographic signs."""
    text = re.sub(r"(?:^|\s)\+- ", "\u00a0±\u00a0", text).replace("R2 ", "R²\u00a0").replace("R^2", "R²")
    text = re.sub(r"\+-(?=\d)", "±", text)
    text = re.sub(r"\b(?:at (?:most|least)|Figs?\.) (?=[-\d])", lambda match: match[0].replace(" ", "\u00a0"), text)
    text = text.replace("Sobol' ", "Sobol’ ")
    text = text.replace("N m", "N\u00a0m")
    text = re.sub(r"(?<=\d) (?=(?:N|deg|mm|um|rpm|%))", "\u00a0", text)
    return re.sub(r"(?<![\w.])-(?=\d)", "−", text)


def _svg(chart: Chart) -> Markup:
    """The figure inline, with its caption as text alternative; the page writes its title above it."""
    untitled = re.sub(r"(<svg[^>]*>)<title>.*?</title>", r"\1", chart.svg(), count=1)
    return Markup(untitled.replace("<svg", Markup('<svg role="img" aria-label="{}"').format(chart.caption), 1))


def _csv_link(chart: Chart) -> str:
    return "data:text/csv;base64," + base64.b64encode(chart.csv().encode()).decode()
