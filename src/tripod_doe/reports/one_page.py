"""One page for decision makers: the question, three sentences and one picture, as HTML or for print."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from tripod_doe.analyses.kinds import of_kind
from tripod_doe.analyses.surrogate.what_if_page import what_if_pages
from tripod_doe.errors import InputError
from tripod_doe.number_text import count_of
from tripod_doe.page_parts.charts.chart import Chart
from tripod_doe.page_parts.charts.files import Paragraph, pdf_page, png_file, svg_file
from tripod_doe.page_parts.main_results import asked, finished
from tripod_doe.page_parts.markdown import plain_lines
from tripod_doe.page_parts.templates import render, typeset
from tripod_doe.reports.study_report import answered, read_analyses
from tripod_doe.study.result_directory.annotation import Annotation, read_annotation
from tripod_doe.study.result_directory.open_cube import is_shown, opened_cube, opened_study

_LONGEST_NOTE, _MOST_LINES = 800, 8  # letters and lines


@dataclass(frozen=True)
class OnePage:
    """The page of a study."""

    title: str
    question: str
    sentences: Sequence[str]  # at most three
    picture: Chart | None
    notes: Sequence[str]  # how far to trust the answer, and what the picture shows
    source: str  # source of the results
    about: Sequence[str] = ()  # owner, tags and the note, as people wrote them

    def html(self) -> str:
        """The page for a browser, which prints on one sheet."""
        return render("one_page.html", page=self)

    def pdf(self) -> bytes:
        """The page for print, A4."""
        above = [Paragraph(self.title, 17, bold=True, gap=0)]
        above += [Paragraph(self.question, 11, quiet=True)] if self.question else []
        above += [Paragraph(line, 9, quiet=True, gap=0.05) for line in self.about]
        above += [Paragraph(typeset(sentence), 12, gap=0.18) for sentence in self.sentences]
        below = list[Paragraph]()
        if self.picture:
            above.append(Paragraph(typeset(self.picture.title), 10, bold=True, gap=0.3))
            below.append(Paragraph(typeset(self.picture.caption), 9, quiet=True, gap=0.1))
        below += [Paragraph(typeset(note), 9, gap=0.2) for note in self.notes]
        below.append(Paragraph(self.source, 8, quiet=True, gap=0.25))
        return pdf_page(above, self.picture, below, self.title)


def one_page(directory: Path) -> OnePage:
    """The page of a result directory, or of the points finished so far.

    Raises:
        CubeError: If the cube or an analysis is missing or damaged.
    """
    analyses = read_analyses(directory) if is_shown(directory) else {}
    about = read_annotation(directory)
    with opened_study(directory) as cube:
        answer = answered(cube, analyses)
        done, total = int(finished(cube).sum()), int(asked(cube).sum())
        attributes = {name: str(value) for name, value in cube.attrs.items()}
    return OnePage(
        about.name or attributes.get("title") or "Study",
        attributes.get("question", ""),
        answer.sentences,
        answer.picture,
        attributes.get("model_notes", "").splitlines()[:1],
        f"{done:,} of {count_of(total, 'point')} finished. {_origin(attributes)}".strip(),
        _about(about),
    )


def _about(annotation: Annotation) -> list[str]:
    """Owner and tags in a line, and the note, of which a page has room for a part."""
    who = [f"Owner: {annotation.owner}"] * bool(annotation.owner)
    who += [f"Tags: {', '.join(annotation.tags)}"] * bool(annotation.tags)
    note = "\n".join(plain_lines(annotation.note))
    shown = note[:_LONGEST_NOTE].splitlines()[:_MOST_LINES]
    if "\n".join(shown) != note:
        shown[-1] += " \u2026"
    return ["; ".join(who)] * bool(who) + shown


def _origin(attributes: Mapping[str, str]) -> str:
    return f"{attributes.get('source', 'tripod_doe')}. Study {attributes.get('study_hash', '')}"


def what_if_alone(directory: Path) -> str:
    """The part of a report that answers "what if", as a page by itself.

    Args:
        directory: Result directory of a study, or of a surrogate step of a workflow.

    Raises:
        CubeError: If the cube or an analysis is missing or damaged.
        InputError: If the results have no surrogate that can be asked.
    """
    with opened_cube(directory) as cube:
        attributes = {name: str(value) for name, value in cube.attrs.items()}
        analyses = read_analyses(directory) if is_shown(directory) else {}
        pages = what_if_pages(analyses | of_kind({directory.name: cube}, "surrogate"))
    if not pages:
        raise InputError(
            "no surrogate that can be asked: the study needs [analysis.surrogate]; of a workflow give the folder of "
            "its surrogate step"
        )
    return render(
        "what_if_page.html",
        title=read_annotation(directory).name or attributes.get("title") or "Study",
        question=attributes.get("question", ""),
        pages=pages,
        source=_origin(attributes),
    )


def figures_of(directory: Path) -> dict[str, bytes]:
    """Every figure of a directory's report, as SVG and as PNG, by file name."""
    analyses = read_analyses(directory) if is_shown(directory) else {}
    files: dict[str, bytes] = {}
    with opened_study(directory) as cube:
        for chart in answered(cube, analyses).charts:
            files |= {f"{chart.name}.svg": svg_file(chart), f"{chart.name}.png": png_file(chart)}
    return files
