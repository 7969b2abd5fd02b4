"""Pages of a workflow: the chain with links to what its steps made, and the pages of its report steps."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import xarray as xr

from tripod_doe.errors import StorageError
from tripod_doe.report.claims import claim_table, find_in_claims, is_claims
from tripod_doe.report.comparison import find_in_comparison
from tripod_doe.report.figures import Chart
from tripod_doe.report.figures.chain import StepView, chain_chart, step_time
from tripod_doe.report.figures.chart import WIDE
from tripod_doe.report.findings import find, find_in_analyses
from tripod_doe.report.page import render
from tripod_doe.report.stability import find_in_stability, is_stability, stability_table

__all__ = ["StoredChart", "chain_page", "find_in_any", "read_charts", "step_page", "write_charts"]


@dataclass(frozen=True)
class StoredChart:
    """A chart that a figure step wrote, as its files hold it."""

    name: str
    caption: str
    folder: Path

    @property
    def wide(self) -> bool:
        """Whether it needs the whole width of a page."""
        width = re.search(r'width="([\d.]+)pt"', self.svg())
        return width is not None and float(width[1]) / 72 > WIDE

    def svg(self) -> str:
        """The figure as an SVG element."""
        return (self.folder / f"{self.name}.svg").read_text(encoding="utf-8")

    def csv(self) -> str:
        """Its numbers."""
        return (self.folder / f"{self.name}.csv").read_text(encoding="utf-8")


def write_charts(charts: Sequence[Chart], step: str, folder: Path) -> None:
    """Write charts as SVG and CSV, and their names and captions as figures.json.

    Raises
    ------
    StorageError
        If a file cannot be written.
    """
    named = [replace(chart, name=f"{step}-{chart.name}") for chart in charts]  # unique in a page of several steps
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for chart in named:
            (folder / f"{chart.name}.svg").write_text(chart.svg(), encoding="utf-8")
            (folder / f"{chart.name}.csv").write_text(chart.csv(), encoding="utf-8")
        captions = {chart.name: chart.caption for chart in named}
        (folder / "figures.json").write_text(json.dumps(captions, indent=1), encoding="utf-8")
    except OSError as error:
        raise StorageError(f"{folder}: cannot write figures: {error.strerror or error}") from error


def read_charts(folder: Path) -> list[StoredChart]:
    """Charts as `write_charts` left them."""
    captions = json.loads((folder / "figures.json").read_text(encoding="utf-8"))
    return [StoredChart(name, caption, folder) for name, caption in captions.items()]


def find_in_any(name: str, data: xr.Dataset) -> list[str]:
    """Sentences on what a study or an analysis found; empty where the house has none for it."""
    if "outcome" in data:
        return find(data)
    if is_claims(data):
        return find_in_claims(data)
    if is_stability(data):
        return find_in_stability(data)
    return find_in_comparison(data) if "amplitude_difference" in data else find_in_analyses({name: data})


@dataclass(frozen=True)
class PagePart:
    """One input of a report step, or one answer of a workflow, as the page shows it; a table is heads and rows."""

    name: str
    title: str
    findings: list[str]
    charts: list[StoredChart]
    link: str
    table: tuple[list[str], list[list[str]]] | None = None


def step_page(
    title: str, order: Sequence[str], data: Mapping[str, xr.Dataset], charts: Mapping[str, Path], notice: str = ""
) -> str:
    """The page of a report step: findings of its studies and analyses, and figures.

    Parameters
    ----------
    title
        Its heading.
    order
        Names of the inputs in the order in which they are shown.
    data
        Cubes of its study and analysis inputs by step.
    charts
        Directories of its figure inputs by step.
    notice
        What the reader must know first; empty for nothing.
    """
    parts = [_part(name, data[name]) if name in data else _drawn(name, charts[name]) for name in order]
    return render("chain.html", title=title, question="", kicker="Report", notice=notice, parts=parts, chain=None,
                  rows=[], text="")  # fmt: skip


def _part(name: str, cube: xr.Dataset) -> PagePart:
    """A study with a link to its own report, or an analysis."""
    link = f"../{name}/report/index.html" if "outcome" in cube else ""
    table = claim_table(cube) if is_claims(cube) else stability_table(cube) if is_stability(cube) else None
    return PagePart(name, str(cube.attrs.get("title", name)), find_in_any(name, cube), [], link, table)


def _drawn(name: str, folder: Path) -> PagePart:
    title = name.replace("-", " ").replace("_", " ")
    return PagePart(name, title[:1].upper() + title[1:], [], read_charts(folder), "")


def chain_page(
    title: str,
    question: str,
    steps: Sequence[StepView],
    notice: str = "",
    text: str = "",
    answers: Mapping[str, xr.Dataset] | None = None,
) -> str:
    """The page of a whole workflow: its answers, the chain as a picture, a row a step with its state, time and link.

    Parameters
    ----------
    title, question
        From the workflow file.
    steps
        Each after all that it needs.
    notice
        What the reader must know first, for instance that this was a quick run.
    text
        The workflow file.
    answers
        By step, the analyses that answer the workflow's question.
    """
    parts = [_part(name, data) for name, data in (answers or {}).items()]
    rows = [(step, step_time(step)) for step in steps]
    return render("chain.html", title=title, question=question, kicker="Workflow", notice=notice, parts=parts,
                  chain=chain_chart(steps), rows=rows, text=text)  # fmt: skip
