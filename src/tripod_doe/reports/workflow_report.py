"""Pages of a workflow: its steps with links to their results, and the pages of its report steps."""

import json
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from html import unescape
from pathlib import Path

import xarray as xr

from tripod_doe.analyses.claims.charts import claims_chart
from tripod_doe.analyses.claims.sentences import claims_of_figures, figures_of_claims
from tripod_doe.analyses.contribution.side_by_side import find_side_by_side, of_one_ladder, side_by_side_table
from tripod_doe.analyses.kinds import is_study, kind_of, of_kind
from tripod_doe.analyses.registry import findings_of, table_of
from tripod_doe.files.checksum_list import refuse_changed, write_listed
from tripod_doe.files.regular_files import read_regular
from tripod_doe.names import path_within
from tripod_doe.number_text import capital, duration
from tripod_doe.page_parts.answer import answer_first, beyond, picture_first
from tripod_doe.page_parts.charts.chart import WIDE, Chart
from tripod_doe.page_parts.templates import render

_THIRD = 300.0  # points; a wider figure is not readable in a third of the page


@dataclass(frozen=True)
class StepView:
    """A step as the table of a page shows it."""

    # name, kind: its name, and its kind of step
    name: str
    kind: str
    inputs: tuple[str, ...]  # names of the steps that it needs
    # ``finished`` (run now), ``reused`` (finished before), ``failed``, ``blocked`` (needs a failed step) or ``not
    # selected``
    state: str
    seconds: float | None = None  # wall time in s of the run that finished it; None if it did not finish
    detail: str = ""  # reason of a failure, or the kind of its result
    link: str = ""  # its report or files, relative to the page; empty if there are none

    @property
    def time(self) -> str:
        """Its wall time as text with its unit, empty if it has none."""
        return "" if self.seconds is None else duration(self.seconds)


@dataclass(frozen=True)
class StoredChart:
    """A chart from the files of a figure step."""

    name: str
    caption: str
    folder: Path

    @property
    def title(self) -> str:
        """Heading in a few words; empty without a title."""
        match = re.search(r"<title>(.*?)</title>", self.svg())
        return unescape(match[1]) if match else ""

    def svg(self) -> str:
        """The figure as an SVG element."""
        return _text(path_within(self.folder, f"{self.name}.svg"))

    def csv(self) -> str:
        """Its numbers."""
        return _text(path_within(self.folder, f"{self.name}.csv"))

    @property
    def width(self) -> float:
        """Width in points as drawn; a page gives wide figures more room."""
        match = re.search(r'<svg[^>]* width="([\d.]+)pt"', self.svg())
        return float(match[1]) if match else 0.0

    @property
    def wide(self) -> bool:
        """Whether it needs the whole width of a page."""
        return self.width / 72 > WIDE


def write_charts(charts: Sequence[Chart], step: str, folder: Path) -> None:
    """Write charts as SVG and CSV, and their names and captions as figures.json.

    Raises:
        StorageError: If a file cannot be written.
    """
    named = [replace(chart, name=f"{step}-{chart.name}") for chart in charts]  # unique in a page of several steps
    for chart in named:
        write_listed(path_within(folder, f"{chart.name}.svg"), chart.svg())
        write_listed(path_within(folder, f"{chart.name}.csv"), chart.csv())
    captions = {chart.name: chart.caption for chart in named}
    write_listed(folder / "figures.json", json.dumps(captions, indent=1))


def _text(path: Path) -> str:
    refuse_changed(path)
    return read_regular(path, links=True).decode()


def read_charts(folder: Path) -> list[StoredChart]:
    """Charts as written by `write_charts`; CubeError if one is damaged."""
    captions = json.loads(_text(folder / "figures.json"))
    return [StoredChart(name, caption, folder) for name, caption in captions.items()]


@dataclass(frozen=True)
class PagePart:
    """One input of a report step, or one answer of a workflow, as the page shows it.

    A table is heads and rows; links are (text, address), a list per row.
    """

    name: str
    title: str
    findings: list[str]
    charts: list[StoredChart]
    link: str
    table: tuple[list[str], list[list[str]]] | None = None
    links: list[list[tuple[str, str]]] = field(default_factory=list)

    @property
    def columns(self) -> str:
        """Number of figures side by side: wide figures need more room, and a single figure gets the full width."""
        if len(self.charts) == 1:
            return "one"
        return "two" if len(self.charts) == 2 or max(chart.width for chart in self.charts) > _THIRD else "three"


def step_page(
    title: str,
    question: str,
    order: Sequence[str],
    data: Mapping[str, xr.Dataset],
    charts: Mapping[str, tuple[str, Path]],
    notice: str = "",
) -> str:
    """The page of a report step: findings of its studies and analyses, and figures with the claims that they show.

    Shows contributions of several models side by side, at the place of the first one.

    Args:
        order: Names of the inputs in the order in which they are shown.
        data: Cubes of its study and analysis inputs by step.
        charts: Headings and directories of its figure inputs by step.
        notice: What the reader must know first; empty for nothing.
    """
    claims = next(iter(of_kind(data, "claims").values()), None)
    ladder = of_one_ladder(data)
    figures = {f"#{name}": heading for name, (heading, _) in charts.items()}
    parts = []
    for name in order:
        if name in ladder:
            if name == next(iter(ladder)):
                parts.append(_side_by_side(name, ladder))
        else:
            link = f"../{name}/report/index.html"
            parts.append(
                _part(name, data[name], figures, link) if name in data else _drawn(name, *charts[name], claims)
            )
    drawn: list[Chart | StoredChart] = [chart for part in parts for chart in part.charts]
    return _page(title, question, "Report", notice, parts, _claims_first(data, drawn))


def _claims_first(data: Mapping[str, xr.Dataset], drawn: Sequence[Chart | StoredChart]) -> Chart | StoredChart | None:
    """The picture of a page: the claims, if it has any, else its first figure."""
    claims = [claims_chart(result) for result in of_kind(data, "claims").values()]
    return picture_first([claims, drawn])


def _page(
    title: str,
    question: str,
    kicker: str,
    notice: str,
    parts: list[PagePart],
    picture: Chart | StoredChart | None,
    *,
    steps: Sequence[StepView] = (),
    text: str = "",
) -> str:
    """Fill the template; analyses come before studies, and sentences of a notice after the first one are folded."""
    stated = [part for part in parts if part.findings]
    analyses = [part.findings for part in stated if not part.link]
    studies = [part.findings for part in stated if part.link]
    firsts, more = (
        [sentences_of[0] for sentences_of in analyses],
        [each for sentences_of in analyses for each in sentences_of[1:]],
    )
    sentences, _ = answer_first([*firsts, *more, *(sentences_of[0] for sentences_of in studies)])
    titles = Counter(part.title for part in parts)
    shown = [
        replace(
            part,
            title=part.title if titles[part.title] == 1 else f"{part.title}: {_words(part.name)}",
            charts=[chart for chart in part.charts if chart is not picture],
            findings=beyond(part.findings, sentences),
        )
        for part in parts
    ]
    head, _, changes = notice.partition(". ")
    return render(
        "chain.html",
        title=title,
        question=question,
        kicker=kicker,
        notice=(head, changes),
        parts=shown,
        sentences=sentences,
        picture=picture,
        steps=steps,
        text=text,
    )


def _part(name: str, cube: xr.Dataset, figures: Mapping[str, str], link: str) -> PagePart:
    """A study with a link to its report, or an analysis; claims link to the figures that show them."""
    title, table = str(cube.attrs.get("title", name)), table_of(cube)
    links = figures_of_claims(cube, figures) if kind_of(cube) == "claims" else []
    return PagePart(name, title, findings_of(name, cube), [], link * is_study(cube), table, links if any(links) else [])


def _side_by_side(name: str, ladder: Mapping[str, xr.Dataset]) -> PagePart:
    """Contributions of several models in one table, then the findings of the most detailed model."""
    finest = list(ladder)[-1]
    findings = find_side_by_side(ladder) + findings_of(finest, ladder[finest])
    return PagePart(name, "Contributions: the models side by side", findings, [], "", side_by_side_table(ladder))


def _words(name: str) -> str:
    return name.replace("-", " ").replace("_", " ")


def _drawn(name: str, title: str, folder: Path, claims: xr.Dataset | None) -> PagePart:
    """A figure, with the claims of the paper's figures that its heading names."""
    table = None if claims is None else claims_of_figures(claims, title)
    return PagePart(name, capital(title or _words(name)), [], read_charts(folder), "", table)


def chain_page(
    title: str,
    question: str,
    steps: Sequence[StepView],
    *,
    notice: str = "",
    text: str = "",
    answers: Mapping[str, xr.Dataset] | None = None,
    figures: Mapping[str, str] | None = None,
) -> str:
    """The page of a workflow: its answers, and one row per step with its state, time and link.

    Args:
        notice: Notice at the top, for instance that this was a quick run.
        answers: By step, the cubes that answer the workflow's question.
        figures: Headings of figures on its report pages by their addresses; claims are linked to them.
    """
    links = {step.name: step.link for step in steps}
    parts = [_part(name, data, figures or {}, links[name]) for name, data in (answers or {}).items()]
    picture = _claims_first(answers or {}, [])
    return _page(title, question, "Workflow", notice, parts, picture, steps=steps, text=text)
