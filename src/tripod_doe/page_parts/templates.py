"""Pages from the templates beside this module, and typographic signs in their sentences."""

import base64
import contextlib
import re
import tomllib
from dataclasses import dataclass
from functools import cache
from importlib.resources import files

from jinja2 import Environment, FileSystemBytecodeCache, PackageLoader, StrictUndefined
from jinja2.bccache import Bucket
from markupsafe import Markup

from tripod_doe.mechanics.compilation.sources import cache_root
from tripod_doe.page_parts.charts.chart import Chart
from tripod_doe.page_parts.markdown import markdown
from tripod_doe.quantities import number, size


class _CompiledTemplates(FileSystemBytecodeCache):
    """Compiled templates on disk; if they cannot be stored, they are compiled again."""

    def dump_bytecode(self, bucket: Bucket) -> None:
        """Store a compiled template if there is room."""
        with contextlib.suppress(OSError):
            super().dump_bytecode(bucket)


def compiled_templates() -> FileSystemBytecodeCache | None:
    """Folder of compiled templates, beside the kernels: compiling them took a tenth of a small run."""
    folder = cache_root() / "templates"
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return None
    return _CompiledTemplates(str(folder))


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
        bytecode_cache=compiled_templates(),
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


@dataclass(frozen=True)
class Reading:
    """The meaning of a kind of sentence."""

    key: str  # anchor on pages and in the guide
    group: str  # kind of page
    title: str
    meaning: str
    computed: str
    patterns: tuple[re.Pattern[str], ...]


@cache
def readings() -> tuple[Reading, ...]:
    """All entries, in the order in which they are tried."""
    tables = tomllib.loads(files("tripod_doe.page_parts").joinpath("sentence_help.toml").read_text(encoding="utf-8"))
    return tuple(
        Reading(
            key,
            table["group"],
            table["title"],
            table["meaning"],
            table["computed"],
            tuple(re.compile(pattern) for pattern in table["match"]),
        )
        for key, table in tables.items()
    )


def reading_of(sentence: str) -> Reading | None:
    """The entry that explains a sentence; None for a sentence that a user wrote."""
    return next((each for each in readings() if any(pattern.search(sentence) for pattern in each.patterns)), None)


def guide_entries() -> str:
    """All entries as Markdown, by kind of page: a part of docs/reference/reports.md."""
    lines, group = [], ""
    for each in readings():
        if each.group != group:
            group = each.group
            lines.append(f"### {group}\n")
        lines.append(f"#### {each.title}\n\n{each.meaning}\n\n*Computed:* {each.computed}\n")
    return "\n".join(lines)
